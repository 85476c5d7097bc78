"""`.dsa` recordings of the Schunk SDH-2: bzip2-compressed XML that carries its own layout and masks.

Format as described by the recordings of peter-kiechle/tactile-sensors: per `<matrix>` size, pitch in mm and masks;
per `<frame>` a time stamp in ms and big-endian float32 in hex, where -k stands for k zeros.
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


def open_dsa(path: Path, sensor: Sensor | None) -> Recording:
    """Open a `.dsa` recording. Raises RecordingCorrupt, TaxelCountWrong."""
    matrices: list[ElementTree.Element] = []
    promised: int | None = None
    try:
        for element in _elements(path):
            if element.tag == "matrix":
                matrices.append(element)
            elif element.tag == "frame_count":
                promised = int(element.text or "")
                break
            elif element.tag == "frame":
                break
        pads = tuple(_pad(matrix) for matrix in matrices)
        here = np.concatenate([_mask(matrix, "static_mask") for matrix in matrices])
        on = np.concatenate([_mask(matrix, "dynamic_mask") for matrix in matrices])
        full_scale = _positive(matrices[0], "fullscale")
    except (OSError, EOFError, ElementTree.ParseError, ValueError) as error:
        raise RecordingCorrupt(path, str(error), _REMEDY) from error
    sensor = sensor or _sensor(pads, full_scale)
    if here.sum() != sensor.wiring.columns:
        raise TaxelCountWrong(path, int(here.sum()), sensor.name, sensor.wiring.columns)
    return Recording(path, "dsa", sensor, lambda: _read(path, here, promised), scans=promised, masked=~on[here])


def _sensor(pads: tuple[Pad, ...], full_scale: float) -> Sensor:
    """The built-in SDH-2, which adds names and scale, if the file has its geometry; else just what the file says."""
    sdh2 = load_sensor(_SDH2)
    if [(p.rows, p.cols, p.pitch_m, set(p.missing)) for p in pads] == [
        (p.rows, p.cols, p.pitch_m, set(p.missing)) for p in sdh2.pads
    ]:
        return sdh2
    return Sensor(name="dsa", unit="count", pads=pads, full_scale=full_scale)


def _pad(matrix: ElementTree.Element) -> Pad:
    rows, cols = int(_text(matrix, "cells_y")), int(_text(matrix, "cells_x"))
    if not (0 < rows <= 1024 and 0 < cols <= 1024):
        raise ValueError(f"a matrix of {rows} x {cols} cells")
    there = _mask(matrix, "static_mask").reshape(rows, cols)
    return Pad(
        name=f"matrix{matrix.get('index')}",
        rows=rows,
        cols=cols,
        pitch_m=(_positive(matrix, "texel_width") / 1e3, _positive(matrix, "texel_height") / 1e3),
        missing=tuple((int(row), int(col)) for row, col in np.argwhere(~there)),
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
    """Finished elements of the XML as far as it can be decompressed; memory does not grow with the file.

    Raises EOFError where the file ends before the XML does.
    """
    unzip = bz2.BZ2Decompressor()
    parser: ElementTree.XMLPullParser[Any] = ElementTree.XMLPullParser(("start", "end"))
    parents: list[ElementTree.Element] = []
    with path.open("rb") as file:
        while piece := file.read(1 << 16):
            text = b"" if unzip.eof else unzip.decompress(piece)
            parser.feed(text)
            for event, element in cast("Iterator[tuple[str, ElementTree.Element]]", parser.read_events()):
                if event == "start":
                    parents.append(element)
                    continue
                parents.pop()
                yield element
                if parents and element.tag in ("frame", "angle", "temp"):
                    parents[-1].remove(element)
    if parents or not unzip.eof:
        raise EOFError("the file ends before its XML does")


def _read(path: Path, here: Bools, promised: int | None) -> Iterator[RawScans]:
    return in_blocks(_frames(path, here, promised), _scans)


def _scans(frames: list[tuple[float, Floats]]) -> RawScans:
    return RawScans(np.array([t_s for t_s, _ in frames]), np.array([values for _, values in frames]))


def _frames(path: Path, here: Bools, promised: int | None) -> Iterator[tuple[float, Floats]]:
    read = 0
    try:
        for element in _elements(path):
            if element.tag == "frame":
                yield (
                    float(_text(element, "time_stamp")) / 1e3,
                    _cells(_text(element, "frame_data"), len(here))[here],
                )
                read += 1
    except (OSError, EOFError, ElementTree.ParseError) as error:
        raise RecordingTruncated(path, read, promised, str(error)) from error
    except ValueError as error:
        raise RecordingCorrupt(path, f"scan {read}: {error}", _REMEDY) from error
    if promised is not None and read < promised:
        raise RecordingTruncated(path, read, promised, "the other frames are not in the file")


def _cells(text: str, cells: int) -> Floats:
    """Undo hex and run lengths: (cells,) readings."""
    words = np.frombuffer(bytes.fromhex("".join(text.split())), ">f4").astype(np.float64)
    repeats = np.where(words < 0, -words, 1.0)
    if repeats.sum() != cells or np.any(repeats != np.round(repeats)):
        raise ValueError(f"{repeats.sum():.0f} cells in a scan of {cells}")
    return np.repeat(np.where(words < 0, 0.0, words), repeats.astype(np.int64))
