"""Sensors, scans, recordings and files made up for tests."""

from __future__ import annotations

import bz2
import itertools
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.estimation.completion import start_slips
from taxelflow.messages import Bools, Estimates, Floats, Footprint, RawScans, Scans, Slips, cut, joined
from taxelflow.runtime import registry
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from taxelflow.condition.session import ConditionSession

METHODS = ("lnorm", "convolution")


def grid_sensor(
    rows: int,
    cols: int,
    *,
    pads: int = 1,
    pitch_m: tuple[float, float] = (0.01, 0.01),
    missing: tuple[tuple[int, int], ...] = (),
    **fields_: Any,
) -> Sensor:
    shape = tuple(
        Pad(name=f"pad{number}", rows=rows, cols=cols, pitch_m=pitch_m, missing=missing) for number in range(pads)
    )
    return Sensor(**{"name": "grid", "unit": "Pa", "pads": shape, **fields_})


def dome(
    sensor: Sensor, x_m: float = 0.0, y_m: float = 0.0, *, peak: float = 50e3, radius_m: float = 0.012, pad: int = 0
) -> Floats:
    """One scan (taxels,) with a Gaussian of pressure on one pad."""
    layout = sensor.layout
    own = layout.of_pad(pad)
    scan = np.zeros(layout.taxels)
    squared = (layout.x_m[own] - x_m) ** 2 + (layout.y_m[own] - y_m) ** 2
    scan[own] = peak * np.exp(-squared / (2 * radius_m**2))
    return scan


def times(scans: int, rate_hz: float = 10.0) -> Floats:
    seconds: Floats = np.arange(scans) / rate_hz
    return seconds


def raw_scans(values: Any, t_s: Any = None) -> RawScans:
    array = np.asarray(values, dtype=np.float64)
    return RawScans(times(len(array)) if t_s is None else np.asarray(t_s, dtype=np.float64), array)


def recorded(
    values: Any, sensor: Sensor, t_s: Any = None, *, block: int = 1024, masked: Bools | None = None
) -> Recording:
    """A recording in memory, given out in blocks."""
    raw = raw_scans(values, t_s)

    def read() -> Iterator[RawScans]:
        return (cut(raw, start, min(start + block, len(raw))) for start in range(0, len(raw), block))

    off = np.zeros(sensor.layout.taxels, dtype=np.bool_) if masked is None else masked
    return Recording("memory", "memory", sensor, read, scans=len(raw), masked=off)


def scans_of(
    sensor: Sensor,
    pressure: Any,
    *,
    t_s: Any = None,
    noise: Any = 1e-9,
    contact: Any = True,
    complete: Any = True,
    ceiling: float = np.inf,
) -> Scans:
    """Conditioned scans (scans, taxels); contact and complete may be given per scan or per scan and pad."""
    values = np.ascontiguousarray(pressure, dtype=np.float64)
    layout = sensor.layout
    flags = []
    for flag in (contact, complete):
        array = np.asarray(flag, dtype=np.bool_)
        array = array[:, np.newaxis] if array.ndim == 1 else array
        flags.append(np.array(np.broadcast_to(array, (len(values), len(layout.pads)))))
    return Scans(
        times(len(values)) if t_s is None else np.asarray(t_s, dtype=np.float64),
        values,
        np.array(np.broadcast_to(np.asarray(noise, dtype=np.float64), (layout.taxels,))),
        np.full(layout.taxels, ceiling),
        flags[0],
        flags[1],
    )


def slips_by(method: str, sensor: Sensor, *blocks: Scans, mode: str = "stream", **parameters: Any) -> Slips:
    """All slips of these blocks by an estimator."""
    session = start_slips(registry.find("estimator", method)(**parameters), sensor.layout, mode)
    slips: Slips = joined([*(session.step(block) for block in blocks), session.finish()])
    return slips


def unknown_slips(scans: Scans) -> Slips:
    """Slips of these scans with nothing in them but their contacts."""
    shape = scans.contact.shape
    footprint = Footprint(scans.t_s, scans.contact, np.zeros((*shape, 2), dtype=np.bool_), np.full(shape, np.nan))
    return Slips.of(footprint, Estimates.unknown(scans))


def seen_slips(t_s: Floats, pose: Floats, displacement: Floats, covariance: Floats) -> Slips:
    """Slips of pads that are all in contact and `ok`, from poses and displacements (scans, pads, 3), the covariance of
    the poses, and twice that of the displacements.
    """
    scans, pads = pose.shape[:2]
    return Slips(
        t_s=t_s,
        contact=np.ones((scans, pads), dtype=np.bool_),
        border=np.zeros((scans, pads, 2), dtype=np.bool_),
        displacement=displacement,
        pose=pose,
        covariance=covariance,
        displacement_covariance=2 * covariance,
        span_s=np.full((scans, pads), t_s[1] - t_s[0]),
        lag_s=np.zeros((scans, pads)),
        load=np.ones((scans, pads)),
        disturbance=np.full((scans, pads), np.nan),
        quality=np.ones((scans, pads), np.uint8),
    )


def conditioned(
    values: Any,
    sensor: Sensor,
    *,
    mode: str = "batch",
    t_s: Any = None,
    cuts: Iterable[int] = (),
    masked: Bools | None = None,
    **parameters: Any,
) -> tuple[Scans, ConditionSession]:
    """Scans through a conditioner in the given mode, contacts split if the sensor asks for it; the session shows what
    it has learned.
    """
    raw = raw_scans(values, t_s)
    off = np.zeros(sensor.layout.taxels, dtype=np.bool_) if masked is None else masked
    session = Conditioner(**parameters).start(sensor, off, [raw] if mode == "batch" else None)
    contacts = ContactFeatures().start(sensor, Conditioner.contact_on, Conditioner.contact_off)
    blocks = [*(scans for piece in pieces(raw, cuts) for scans in session.step(piece)), *session.finish()]
    return joined([contacts.step(block).scans for block in blocks]), session


def pieces(block: Any, cuts: Iterable[int]) -> list[Any]:
    """A block cut at these scans, in any order, repeats allowed (they give empty blocks)."""
    edges = [0, *sorted(cuts), len(block)]
    return [cut(block, start, stop) for start, stop in itertools.pairwise(edges)]


def assert_same(one: Any, other: Any) -> None:
    """Two messages hold the same bits; unknown equals unknown."""
    for field in fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


class DsaMatrix:
    """One `<matrix>` of a .dsa file. Masks are rows of 0 and 1."""

    def __init__(self, rows: int, cols: int, static: str | None = None, dynamic: str | None = None) -> None:
        self.rows, self.cols = rows, cols
        self.static = static or "1" * (rows * cols)
        self.dynamic = dynamic or "1" * (rows * cols)

    @property
    def cells(self) -> int:
        return self.rows * self.cols

    def xml(self, index: int) -> str:
        def mask(digits: str) -> str:
            return "\n".join(digits[start : start + self.cols] for start in range(0, self.cells, self.cols))

        return (
            f'<matrix index="{index}" name=""><cells_x>{self.cols}</cells_x><cells_y>{self.rows}</cells_y>'
            "<texel_width>3.4</texel_width><texel_height>3.5</texel_height><fullscale>4095</fullscale>"
            f"<static_mask>\n{mask(self.static)}\n</static_mask><dynamic_mask>\n{mask(self.dynamic)}\n</dynamic_mask>"
            "</matrix>"
        )


def dsa_words(cells: Sequence[float], *, packed: bool = True) -> str:
    """Hex of one scan; runs of zeros become one negative word, lines break after 7 words."""
    words: list[float] = []
    for zero, run in itertools.groupby(cells, key=lambda value: value == 0):
        values = list(run)
        words += [-len(values)] if zero and packed else values
    text = np.array(words, dtype=">f4").tobytes().hex().upper()
    return "\n      ".join(text[start : start + 56] for start in range(0, len(text), 56))


def dsa_xml(
    matrices: Sequence[DsaMatrix], frames: Iterable[tuple[Any, str]], *, promised: int | None, head: str = ""
) -> str:
    """XML of a .dsa file from frames of (time stamp in ms, hex words)."""
    count = "" if promised is None else f"<frame_count>{promised}</frame_count>"
    body = "\n".join(
        f'<frame index="{number}"><time_stamp>{stamp}</time_stamp><frame_data>\n      {words}\n</frame_data></frame>'
        for number, (stamp, words) in enumerate(frames)
    )
    sensor = "".join(matrix.xml(index) for index, matrix in enumerate(matrices))
    return (
        f'<?xml version="1.0" encoding="utf-8"?>\n<root>\n<sensor name="">{head}{sensor}</sensor>\n'
        f"<data>{count}\n{body}\n</data>\n</root>\n"
    )


def write_dsa(
    path: Path, scans: Floats, matrices: Sequence[DsaMatrix], *, first_ms: int = 1_000, step_ms: int = 32
) -> Path:
    """A whole .dsa file; scans: (scans, cells) with every cell, absent ones too."""
    frames = [(first_ms + step_ms * number, dsa_words(scan.tolist())) for number, scan in enumerate(scans)]
    path.write_bytes(bz2.compress(dsa_xml(matrices, frames, promised=len(frames)).encode(), 1))
    return path
