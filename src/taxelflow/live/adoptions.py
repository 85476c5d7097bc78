"""When a run used what it had learned, from the file of the run: with it the same scans give the same results."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from taxelflow.acquire.ros.mcap import McapSource
from taxelflow.errors import AddressInvalid, RecordingTruncated
from taxelflow.runtime.addresses import parse_address
from taxelflow.runtime.adoption import Adoption

if TYPE_CHECKING:
    from taxelflow.runtime.addresses import Address

ADOPTIONS = "/adoptions"
"""The topic in an MCAP file."""
OPTION, ALLOWED = "adoptions", ("ready", "recorded")
"""Of `replay:`: use what is learned when it is ready, or in the scans in which the recorded run did."""


def asked_adoptions(url: str) -> list[Adoption] | None:
    """Those that the URL of a source asks for: of `replay:FILE.mcap?adoptions=recorded`, else None.

    Raises AddressInvalid, RecordingTooLarge, OSError.
    """
    address = parse_address(url)
    if address.scheme != "replay" or address.choice(OPTION, ALLOWED) == "ready":
        return None
    return _read(address, Path(address.need_path("replay:FILE")))


def _read(address: Address, path: Path) -> list[Adoption]:
    if path.suffix != ".mcap":
        raise AddressInvalid(address.url, f"{path.name} holds no adoptions", "a file by `taxelflow run --to mcap:FILE`")
    source, found = McapSource(path), []
    for topic in source.topics:
        if topic.name == ADOPTIONS:
            with suppress(RecordingTruncated):  # what is whole is used; the replay of the scans says that it was cut
                found += [msgspec.json.decode(content) for _, content in source.messages(topic)]
    return [Adoption(one["what"], one["number"], one["t_s"]) for one in found]
