"""Lines of text, `t_s,v1,...,vn`: what every microcontroller can print."""

from __future__ import annotations

import codecs
import math
from typing import TYPE_CHECKING

import msgspec
import numpy as np

if TYPE_CHECKING:
    from taxelflow.acquire.devices.base import Faults
    from taxelflow.messages import Floats

_LONGEST_LINE = 1 << 20
"""Bytes held while no line ends: bounds the memory for a stream that is no text."""
_SEPARATORS = bytes.maketrans(b";\t", b",,")
_DECODER = msgspec.json.Decoder(list[float])


class LineParser:
    """Lines `t_s,v1,...,vn`, or `v1,...,vn` if the device sends no time.

    Fields stand between commas, semicolons, tabs or blanks; an empty field between commas, or `nan`, is a missing
    reading. Lines end with a newline or a carriage return; those that begin with # are comments.
    """

    def __init__(
        self,
        columns: int,
        faults: Faults,
        *,
        timed: bool,
        joins_late: bool = False,
        ends_cut: bool = False,
        per_second: float = 1.0,
    ) -> None:
        """joins_late: the first bytes may be the rest of a line, and are left out up to its end. ends_cut: the last
        line may be the beginning of one, and counts with its newline only. per_second: units of times.
        """
        self._columns, self._faults, self._timed, self._per_second = columns, faults, timed, per_second
        self._joins_late, self._ends_cut = joins_late, ends_cut
        self.restart()

    def restart(self) -> None:
        """See `Parser`."""
        self._rest = b""
        self._skips = self._joins_late
        self._endless = False

    def feed(self, received: bytes) -> list[tuple[float | None, Floats]]:
        """See `Parser`."""
        *lines, self._rest = (self._rest + received.replace(b"\r", b"\n")).split(b"\n")
        if self._skips and lines:
            self._skips = self._endless = False
            del lines[0]
        if len(self._rest) > _LONGEST_LINE:
            if not self._endless:  # else it is the rest of a line that has been counted
                self._faults.count("bad line", f"more than {_LONGEST_LINE} bytes without an end")
            self._rest, self._skips, self._endless = b"", True, True
        return [scan for line in lines if (scan := self._scan(line)) is not None]

    def end(self) -> list[tuple[float | None, Floats]]:
        """See `Parser`. A line that was cut in its last number has the right count of numbers: only the newline
        shows that it is complete.
        """
        rest = self._rest.strip()
        if self._ends_cut and rest and not rest.startswith(b"#") and not self._skips:
            seen = rest[-20:].decode(errors="replace")
            self._faults.count("bad line", f"the last one, ...{seen!r}, may be cut; send a newline after each line")
            self._rest = b""
        return self.feed(b"\n") if self._rest else []

    def _scan(self, line: bytes) -> tuple[float | None, Floats] | None:
        line = line.removeprefix(codecs.BOM_UTF8).strip()  # with which Windows begins what it pipes
        if not line or line.startswith(b"#"):
            return None
        wanted, numbers = self._columns + self._timed, _plain(line)
        if numbers is None or len(numbers) != wanted:
            numbers = self._numbers(line, wanted)
        if numbers is None:
            return None
        if not self._timed:
            return None, np.array(numbers)
        if not math.isfinite(numbers[0]):
            self._faults.count("bad line", f"its time is {numbers[0]}")
            return None
        return numbers[0] / self._per_second, np.array(numbers[1:])

    def _numbers(self, line: bytes, wanted: int) -> list[float] | None:
        """Numbers of a line written in any way; None if it is no scan."""
        fields = line.translate(_SEPARATORS).split(b",")
        if len(fields) == 1 != wanted:
            fields = line.split()
        after_each = (wanted, wanted + 1) if self._timed else (wanted + 1,)
        if len(fields) in after_each and not fields[-1].strip():
            # A comma after each number, the last one as well: a line of as many fields as time and readings that ends
            # in one has no time. A last reading that is missing is written as nan.
            fields.pop()
        if len(fields) != wanted:
            form = "time and readings" if self._timed else "readings"
            hint = "; for lines without time: ?time=arrival" if self._timed and len(fields) == self._columns else ""
            self._faults.count("bad line", f"{len(fields)} numbers, {wanted} expected ({form}){hint}")
            return None
        try:
            if b"_" in line:  # which Python reads between digits
                raise ValueError
            return [float(field) if field.strip() else math.nan for field in fields]
        except ValueError:
            self._faults.count("bad line", f"not numbers: {line[:60].decode(errors='replace')!r}")
            return None


def _plain(line: bytes) -> list[float] | None:
    """Numbers of a line that has nothing but plain ones between commas, None of others: in a sixth of the time.

    They are read as JSON, which other lines are not; JSON's whole numbers have no -0.
    """
    if b"\t" in line or line.count(b"-0") != line.count(b"-0."):
        return None
    try:
        return _DECODER.decode(b"[%b]" % line)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None


def line_of(t_s: float | None, values: Floats) -> bytes:
    """A scan as a line, exact."""
    numbers = values.tolist() if t_s is None else [t_s, *values.tolist()]
    return ",".join(map(repr, numbers)).encode() + b"\n"
