"""Adoptions of a run, and scans that it was too slow for, read from the file of the run.

With both the same scans give the same results once more.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import msgspec

from taxelflow.acquire.ros.mcap import McapSource
from taxelflow.errors import AddressInvalid, RecordingTruncated
from taxelflow.runtime.addresses import parse_address
from taxelflow.runtime.adoption import Adoption

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.acquire.ros.topics import Topic
    from taxelflow.runtime.addresses import Address

ADOPTIONS, MISSED, RESULTS = "/adoptions", "/missed", "/slips"
"""The topics in an MCAP file; a run that estimated has the last, even if it adopted and missed nothing."""
OPTION, ALLOWED = "adoptions", ("ready", "recorded")
"""Of `replay:`: use what is learned when it is ready, or in the scans in which the recorded run did."""


def asked_adoptions(url: str) -> list[Adoption] | None:
    """Those that the URL of a source asks for: of `replay:FILE.mcap?adoptions=recorded`, else None.

    Raises AddressInvalid, RecordingTooLarge, OSError.
    """
    address = parse_address(url)
    if address.scheme != "replay" or not _recorded(address):
        return None
    return [Adoption(one["what"], one["number"], one["t_s"]) for one in _read(address, ADOPTIONS)]


def asked_missed(address: Address) -> frozenset[float]:
    """Times of the scans, s, that the recorded run had no time for; none unless `adoptions=recorded` asks for them.

    Raises AddressInvalid, RecordingTooLarge, OSError.
    """
    return frozenset(one["t_s"] for one in _read(address, MISSED)) if _recorded(address) else frozenset()


def _recorded(address: Address) -> bool:
    return address.choice(OPTION, ALLOWED) == "recorded"


def _read(address: Address, name: str) -> list[dict[str, Any]]:
    """All messages of a topic."""
    path = address.file_path("replay:FILE")
    source = McapSource(path) if path.suffix == ".mcap" else None
    if source is None or RESULTS not in {topic.name for topic in source.topics}:
        raise AddressInvalid(address.url, f"{path.name} holds no adoptions", "a file by `taxelflow run --to mcap:FILE`")
    found = list[dict[str, Any]]()
    for topic in source.topics:
        if topic.name == name:
            found += _whole(source, topic)
    return found


def _whole(source: McapSource, topic: Topic) -> Iterator[dict[str, Any]]:
    """Messages until the end, or until the file was cut: the replay of the scans reports that."""
    with suppress(RecordingTruncated):
        for _, content in source.messages(topic):
            yield msgspec.json.decode(content)
