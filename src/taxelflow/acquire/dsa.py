"""`.dsa` recordings of the Schunk SDH-2: bzip2-compressed XML that holds its own layout and masks.

Format as described by the recordings of peter-kiechle/tactile-sensors: per `<matrix>` size, pitch in mm and masks;
per `<frame>` a time stamp in ms and big-endian float32 in hex, where -k encodes k zeros.
"""

from __future__ import annotations

import bz2
from typing import TYPE_CHECKING, Any, cast
from xml.etree import ElementTree

import numpy as np

from taxelflow.acquire.base import Recording, in_blocks
from taxelflow.errors import RecordingCorrupt, RecordingTruncated, TaxelCountWrong
from taxelflow.messages import Bools, Floats, RawScans
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_REMEDY = "a .dsa recording is bzip2-compressed XML with <matrix> and <frame> elements"
_SDH2 = "schunk-sdh2"
_MOST_CELLS = 1024
"""Rows or columns of a matrix at most, as in a sensor file."""
_PIECE_BYTES = 1 << 16
"""Compressed bytes that are decompressed and parsed at a time."""


def open_dsa(path: Path, sensor: Sensor | None) -> Recording:
    """Open a `.dsa` recording. Raises RecordingCorrupt, TaxelCountWrong."""
    try:
        matrices, scans = _head(path)
        pads = tuple(_pad(matrix) for matrix in matrices)
        present = np.concatenate([_mask(matrix, "static_mask") for matrix in matrices])
        enabled = np.concatenate([_mask(matrix, "dynamic_mask") for matrix in matrices])
        full_scale = _positive(matrices[0], "fullscale")
    except (OSError, EOFError, ElementTree.ParseError, ValueError) as error:
        raise RecordingCorrupt(path, str(error), _REMEDY) from error
    sensor = sensor or _sensor(pads, full_scale)
    if present.sum() != sensor.channel_map.columns:
        raise TaxelCountWrong(path, int(present.sum()), sensor.name, sensor.channel_map.columns)
    masked = ~enabled[present]
    return Recording(path, "dsa", sensor, lambda: _read(path, present, scans), scans=scans, masked=masked)


def _head(path: Path) -> tuple[list[ElementTree.Element], int | None]:
    """The `<matrix>` elements, and the number of scans if the file declares it before the first one."""
    matrices: list[ElementTree.Element] = []
    for element in _elements(path):
        if element.tag == "matrix":
            matrices.append(element)
        elif element.tag == "frame_count":
            return matrices, int(element.text or "")
        elif element.tag == "frame":
            break
    return matrices, None


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
    if not (0 < rows <= _MOST_CELLS and 0 < cols <= _MOST_CELLS):
        raise ValueError(f"a matrix of {rows} x {cols} cells")
    present = _mask(matrix, "static_mask").reshape(rows, cols)
    return Pad(
        name=f"matrix{matrix.get('index')}",
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
    """Complete elements of the XML as far as it can be decompressed; memory does not grow with the file.

    Raises EOFError where the file ends before the XML does.
    """
    unzip = bz2.BZ2Decompressor()
    parser: ElementTree.XMLPullParser[Any] = ElementTree.XMLPullParser(("start", "end"))
    parents: list[ElementTree.Element] = []
    with path.open("rb") as file:
        while piece := file.read(_PIECE_BYTES):
            parser.feed(b"" if unzip.eof else unzip.decompress(piece))
            yield from _complete(parser, parents)
    if parents or not unzip.eof:
        raise EOFError("the file ends before its XML does")


def _complete(
    parser: ElementTree.XMLPullParser[Any], parents: list[ElementTree.Element]
) -> Iterator[ElementTree.Element]:
    """Elements that end in the text fed so far. parents: the open ones, updated; per-scan elements are freed."""
    for event, element in cast("Iterator[tuple[str, ElementTree.Element]]", parser.read_events()):
        if event == "start":
            parents.append(element)
            continue
        parents.pop()
        yield element
        if parents and element.tag in ("frame", "angle", "temp"):
            parents[-1].remove(element)


def _read(path: Path, present: Bools, declared: int | None) -> Iterator[RawScans]:
    return in_blocks(_frames(path, present, declared), _scans)


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
