"""`.dsa` recordings of the Schunk SDH-2: bzip2-compressed XML that holds its own layout and masks.

Format as described by the recordings of peter-kiechle/tactile-sensors: per `<matrix>` size, pitch in mm and masks;
per `<frame>` a time stamp in ms and big-endian float32 in hex, where -k encodes k zeros; in some files after them, per
`<angle>` a time stamp in ms and the angles of seven joints in degrees.
"""

from __future__ import annotations

import bz2
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.acquire.blocks import in_blocks
from taxelflow.acquire.joints import joints_of
from taxelflow.acquire.limits import Budget, scans_per_block
from taxelflow.errors import RecordingCorrupt, RecordingTruncated, TaxelCountWrong
from taxelflow.messages import Bools, Floats, Joints, RawScans
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.names import safe_name
from taxelflow.sensors.pads import MOST, Pad
from taxelflow.sensors.sensor import Sensor
from taxelflow.sensors.validation import check_sizes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_REMEDY = "a .dsa recording is bzip2-compressed XML with <matrix> and <frame> elements"
_SDH2 = "schunk-sdh2"
_READ = ("matrix", "frame_count", "frame", "angle")
"""Elements that are read; the text of `frame_count` is the number of scans."""
_JOINTS = (
    "sdh_knuckle_joint", "sdh_finger_22_joint", "sdh_finger_23_joint", "sdh_thumb_2_joint", "sdh_thumb_3_joint",
    "sdh_finger_12_joint", "sdh_finger_13_joint",
)  # fmt: skip
"""Joints in the order of the hand's controller, axes 0 to 6, by their names in schunk_modular_robotics."""
_PIECE_BYTES = 1 << 16
"""Bytes that are decompressed and parsed at a time."""
_MOST_ELEMENT = 1 << 22
"""Memory of a scan or a matrix at most: 32,768 cells in hex need 0.3 MB."""


@dataclass(frozen=True, slots=True)
class _Element:
    """Elements of the XML."""

    bytes: int = 100
    """Memory of one without text."""
    charge: int = 256
    """Bytes that one counts for in what a file unpacks to: so long its parsing takes."""
    depth: int = 32
    """Depth at most; recordings have 5."""


_ELEMENT = _Element()


def open_dsa(path: Path, sensor: Sensor | None) -> Recording:
    """Open a `.dsa` recording. Raises RecordingCorrupt, TaxelCountWrong."""
    try:
        matrices, scans = _head(path)
        pads = tuple(_pad(matrix) for matrix in matrices)
        joints = _joints(path)
        present = np.concatenate([_mask(matrix, "static_mask") for matrix in matrices])
        enabled = np.concatenate([_mask(matrix, "dynamic_mask") for matrix in matrices])
        full_scale = _positive(matrices[0], "fullscale")
    except (OSError, EOFError, ElementTree.ParseError, ValueError) as error:
        raise RecordingCorrupt(path, str(error), _REMEDY) from error
    check_sizes(pads, (), f"{path}:matrix")
    sensor = sensor or _sensor(pads, full_scale)
    if present.sum() != sensor.channel_map.columns:
        raise TaxelCountWrong(path, int(present.sum()), sensor.name, sensor.channel_map.columns)
    masked = ~enabled[present]
    block = scans_per_block(sensor)
    return Recording(
        path, "dsa", sensor, lambda: _read(path, present, scans, block), scans=scans, masked=masked, joints=joints
    )


def _head(path: Path) -> tuple[list[ElementTree.Element], int | None]:
    """The `<matrix>` elements, and the number of scans if the file declares it before the first one."""
    matrices: list[ElementTree.Element] = []
    held = 0
    for element in _elements(path):
        if element.tag == "matrix":
            matrices.append(element)
            held += sum(map(len, element.itertext()))
            if len(matrices) > MOST.pads or held > _MOST_ELEMENT:
                raise ValueError(f"its {len(matrices)} first matrices hold {held} characters")
        elif element.tag == "frame_count":
            return matrices, int(element.text or "")
        elif element.tag == "frame":
            break
    return matrices, None


def _joints(path: Path) -> Joints | None:
    """The joint angles that stand after the scans, if there are any; None for a damaged file, too."""
    t_s: list[float] = []
    degrees: list[list[float]] = []
    try:
        for element in _elements(path):
            if element.tag == "angle" and element.find("angle_data") is not None:
                t_s.append(float(_text(element, "time_stamp")) / 1e3)
                degrees.append([float(number) for number in _text(element, "angle_data").split(",")])
    except (EOFError, OSError, ElementTree.ParseError):
        pass  # the scans before the damage are read all the same, and reading them reports what is lost
    if not degrees or any(len(row) != len(_JOINTS) for row in degrees):
        return None
    return joints_of(_JOINTS, np.array(t_s), np.radians(degrees))


def _sensor(pads: tuple[Pad, ...], full_scale: float) -> Sensor:
    """The built-in SDH-2, which adds names and scale, if the file has its geometry; else a sensor as in the file."""
    sdh2 = load_sensor(_SDH2)
    if [(p.rows, p.cols, p.pitch_m, set(p.missing)) for p in pads] == [
        (p.rows, p.cols, p.pitch_m, set(p.missing)) for p in sdh2.pads
    ]:
        return sdh2
    return Sensor(name="dsa", unit="count", pads=pads, full_scale=full_scale)


def _pad(matrix: ElementTree.Element) -> Pad:
    rows, cols = int(_text(matrix, "cells_y")), int(_text(matrix, "cells_x"))
    if not (0 < rows <= MOST.cells and 0 < cols <= MOST.cells):
        raise ValueError(f"a matrix of {rows} x {cols} cells")
    present = _mask(matrix, "static_mask").reshape(rows, cols)
    return Pad(
        name=safe_name(f"matrix{matrix.get('index')}"),
        rows=rows,
        cols=cols,
        pitch_m=(_positive(matrix, "texel_width") / 1e3, _positive(matrix, "texel_height") / 1e3),
        missing=tuple((int(row), int(col)) for row, col in np.argwhere(~present)),
    )


def _positive(element: ElementTree.Element, name: str) -> float:
    number = float(_text(element, name))
    if not 0 < number < float("inf"):
        raise ValueError(f"<{name}> is {number}")
    return number


def _mask(matrix: ElementTree.Element, name: str) -> Bools:
    cells = int(_text(matrix, "cells_y")) * int(_text(matrix, "cells_x"))
    digits = "".join(_text(matrix, name).split())
    if len(digits) != cells:
        raise ValueError(f"<{name}> has {len(digits)} digits for {cells} cells")
    return np.array([digit != "0" for digit in digits])


def _text(element: ElementTree.Element, name: str) -> str:
    text = element.findtext(name)
    if text is None:
        raise ValueError(f"<{element.tag}> has no <{name}>")
    return text


def _elements(path: Path) -> Iterator[ElementTree.Element]:
    """The `<matrix>`, `<frame_count>` and `<frame>` elements as far as the XML can be decompressed.

    Memory grows neither with the file nor with what it unpacks to. Raises ParseError, ValueError, EOFError where the
    file ends before the XML does, RecordingTooLarge.
    """
    unzip = bz2.BZ2Decompressor()
    budget = Budget(path)
    found = _Found()
    parser = ElementTree.XMLParser(target=found)
    with path.open("rb") as file:
        while not unzip.eof:
            piece = file.read(_PIECE_BYTES) if unzip.needs_input else b""
            if not piece and unzip.needs_input:
                break
            text = unzip.decompress(piece, _PIECE_BYTES)
            budget.spend(len(text) + _ELEMENT.charge * found.elements)
            found.elements = 0
            try:
                parser.feed(text)
            except (ElementTree.ParseError, ValueError):
                yield from found.complete
                raise
            yield from found.complete
            found.complete.clear()
    if found.depth or not unzip.eof:
        raise EOFError("the file ends before its XML does")


class _Found:
    """Target of the XML parser: elements that are read, when they are complete; all others are dropped.

    depth: of the element that is open now. elements: number begun since this was last set to 0.
    """

    def __init__(self) -> None:
        self.complete: list[ElementTree.Element] = []
        self.depth = self.elements = 0
        self._builder: ElementTree.TreeBuilder | None = None
        self._outside = self._held = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """An element begins."""
        self.depth += 1
        self.elements += 1
        if self.depth > _ELEMENT.depth:
            raise ValueError(f"elements are nested more than {_ELEMENT.depth} deep")
        if self._builder is None and tag in _READ:
            self._builder, self._outside, self._held = ElementTree.TreeBuilder(), self.depth, 0
        if self._builder is not None:
            self._hold(_ELEMENT.bytes)
            self._builder.start(tag, attributes)

    def data(self, text: str) -> None:
        """Text of the open element."""
        if self._builder is not None:
            self._hold(len(text))
            self._builder.data(text)

    def _hold(self, size: int) -> None:
        self._held += size
        if self._held > _MOST_ELEMENT:
            raise ValueError(f"a scan or matrix takes more than {_MOST_ELEMENT} bytes")

    def end(self, tag: str) -> None:
        """The open element ends."""
        if self._builder is not None:
            self._builder.end(tag)
            if self.depth == self._outside:
                self.complete.append(self._builder.close())
                self._builder = None
        self.depth -= 1

    def doctype(self, name: str, *_identifiers: str | None) -> None:
        """A document type could define entities that unpack to any length."""
        raise ValueError(f"it declares a document type ({name})")


def _read(path: Path, present: Bools, declared: int | None, block: int) -> Iterator[RawScans]:
    return in_blocks(_frames(path, present, declared), _scans, lambda frame: frame[1].nbytes, block)


def _scans(frames: list[tuple[float, Floats]]) -> RawScans:
    return RawScans(np.array([t_s for t_s, _ in frames]), np.array([values for _, values in frames]))


def _frames(path: Path, present: Bools, declared: int | None) -> Iterator[tuple[float, Floats]]:
    """Time stamp in s and readings (taxels,) of each scan. Raises RecordingTruncated, RecordingCorrupt."""
    read = 0
    try:
        for frame in (element for element in _elements(path) if element.tag == "frame"):
            t_s = float(_text(frame, "time_stamp")) / 1e3
            yield t_s, _cells(_text(frame, "frame_data"), len(present))[present]
            read += 1
    except (OSError, EOFError, ElementTree.ParseError) as error:
        raise RecordingTruncated(path, read, declared, str(error)) from error
    except ValueError as error:
        raise RecordingCorrupt(path, f"scan {read}: {error}", _REMEDY) from error
    if declared is not None and read < declared:
        raise RecordingTruncated(path, read, declared, "the other frames are not in the file")


def _cells(text: str, cells: int) -> Floats:
    """Decode hex and run lengths: (cells,) readings."""
    words = np.frombuffer(bytes.fromhex("".join(text.split())), ">f4").astype(np.float64)
    repeats = np.where(words < 0, -words, 1.0)
    if repeats.sum() != cells or np.any(repeats != np.round(repeats)):
        raise ValueError(f"{repeats.sum():.0f} cells in a scan of {cells}")
    return np.repeat(np.where(words < 0, 0.0, words), repeats.astype(np.int64))
