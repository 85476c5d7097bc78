"""Sources and sinks by URL, such as `tcp://127.0.0.1:5000`, `serial:/dev/ttyUSB0?baud=921600` or `jsonl:-`."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, unquote, urlsplit

from taxelflow.errors import AddressInvalid

if TYPE_CHECKING:
    from collections.abc import Collection

MOST_PORT = 65535
"""Largest port number of TCP and UDP."""


@dataclass(frozen=True)
class Address:
    """A URL in parts.

    scheme: what names the part of the registry. host, port: empty and None without `//`. path: what follows, without
    the leading slash if there is a host. options: those after the question mark.
    """

    url: str
    scheme: str
    host: str = ""
    port: int | None = None
    path: str = ""
    options: dict[str, str] = field(default_factory=dict)

    @property
    def endpoint(self) -> tuple[str, int]:
        """Host and port, and nothing after them. Raises AddressInvalid."""
        if not self.host or self.port is None:
            raise AddressInvalid(self.url, "it has no host and port", f"{self.scheme}://HOST:PORT")
        self.refuse_path(f"{self.scheme}://HOST:PORT")
        return self.host, self.port

    def refuse_path(self, example: str) -> None:
        """Raises AddressInvalid, with an example, if there is a path, or a host that the example has none of."""
        if self.path:
            raise AddressInvalid(self.url, f"the path {self.path!r} has no meaning here", example)
        if self.host and "://" not in example:
            raise AddressInvalid(self.url, f"the host {self.host!r} has no meaning here", example)

    def need_path(self, example: str) -> str:
        """The path. Raises AddressInvalid if it is empty, or a part of it stands where a host does in the example."""
        behind = self.url.partition(":")[2].partition("?")[0]
        if behind.startswith("//") and "://" not in example:
            raise AddressInvalid(self.url, "// is followed by a host, not by a path", f"{self.scheme}:{behind[2:]}")
        if not self.path:
            raise AddressInvalid(self.url, "it has no path", example)
        return self.path

    def file_path(self, example: str) -> Path:
        """The path of a file; `~` is the home directory. Raises AddressInvalid, with an example, if it is empty."""
        path = Path(self.need_path(example))
        try:
            return path.expanduser()
        except RuntimeError as error:
            raise AddressInvalid(self.url, f"no home directory is known for {path.parts[0]}", example) from error

    def check_options(self, known: Collection[str]) -> None:
        """Raises AddressInvalid for an option that has no meaning here."""
        for name in self.options:
            if name not in known:
                listed = f"options: {', '.join(sorted(known))}" if known else "no options"
                in_path = "; ? in a path is written %3F" if self.path and not self.host else ""
                raise AddressInvalid(self.url, f"unknown option {name!r}", listed + in_path)

    def number(self, name: str, default: float, lowest: float = 0.0, highest: float = math.inf) -> float:
        """The option of that name as a finite number, from `lowest` to `highest`. Raises AddressInvalid."""
        text = self.options.get(name)
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not (lowest <= value <= highest and math.isfinite(value)):
            allowed = f"at least {lowest:g}" if math.isinf(highest) else f"{lowest:g} to {highest:g}"
            raise AddressInvalid(self.url, f"{name}={text}", f"{name}=NUMBER, {allowed}")
        return value

    def whole(self, name: str, default: int, lowest: int = 0) -> int:
        """The option of that name as a whole number, at least `lowest`. Raises AddressInvalid."""
        value = self.number(name, default, lowest)
        if value != round(value):
            raise AddressInvalid(self.url, f"{name}={self.options[name]}", f"{name}=NUMBER without fraction")
        return round(value)

    def choice(self, name: str, allowed: tuple[str, ...]) -> str:
        """The option of that name, one of `allowed`, of which the first is the default. Raises AddressInvalid."""
        text = self.options.get(name, allowed[0])
        if text not in allowed:
            raise AddressInvalid(self.url, f"{name}={text}", f"{name}={' or '.join(allowed)}")
        return text

    def flag(self, name: str) -> bool:
        """The option of that name, 0 or 1. Raises AddressInvalid."""
        return self.choice(name, ("0", "1")) == "1"


def parse_address(url: str, path_form: str = "") -> Address:
    """A URL in parts. path_form: what a mere path was likely meant as. Raises AddressInvalid."""
    try:
        parts = urlsplit(url, allow_fragments=False)
        port = parts.port
    except ValueError as error:
        raise AddressInvalid(url, str(error), "SCHEME://HOST:PORT or SCHEME:PATH") from error
    if not parts.scheme or ":" not in url:
        meant = f"{path_form}, or " if path_form else ""
        raise AddressInvalid(url, "it has no scheme", f"{meant}SCHEME://HOST:PORT or SCHEME:PATH")
    given = parse_qsl(parts.query, keep_blank_values=True)
    options = dict(given)
    if len(options) < len(given):
        twice = Counter(name for name, _ in given).most_common(1)[0][0]
        raise AddressInvalid(url, f"option {twice!r} is given twice", "each option once")
    path = unquote(parts.path)
    host = parts.hostname or ""
    if url.partition(":")[2].startswith("//"):
        path = path.removeprefix("/")
        if port is not None and not 0 <= port <= MOST_PORT:
            raise AddressInvalid(url, f"port {port}", "a port from 0 to 65535")
    return Address(url, parts.scheme, host, port, path, options)
