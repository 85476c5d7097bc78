"""Simulation of a pressing: readings of a rigid relief that moves over an elastic skin, with its true poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.acquire.base import Recording, Truth
from taxelflow.acquire.blocks import cut_up
from taxelflow.errors import NameUnknown
from taxelflow.messages import RawScans
from taxelflow.numerics.geometry import rotation
from taxelflow.simulation.relief.balance import Sites, depths, pressure_at, settle
from taxelflow.simulation.relief.body import body_of
from taxelflow.simulation.relief.course import follow
from taxelflow.simulation.relief.faults import delays, readings
from taxelflow.simulation.relief.foundation import foundation_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor
    from taxelflow.simulation.relief.course import Followed
    from taxelflow.simulation.relief.foundation import Foundation
    from taxelflow.simulation.relief.parameters import Pressing

    Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class _Search:
    """How the balance is searched, and with what."""

    least_n: float = 0.01
    """The force from which it is searched for, N."""
    scans: int = 12
    """Scans that are solved together: few, for they touch about the same points, and only those are computed with."""
    gap: float = 3.0
    """Height below the top, in heights of the relief, from which a point is taken not to touch; checked afterwards."""


_SEARCH = _Search()


def simulate_relief(pressing: Pressing, sensor: Sensor, pad: str) -> Recording:
    """The recording of a pressing on one pad, with truth, in memory. Raises NameUnknown, ParameterInvalid.

    The truth is the pose of the object's load point in the pad's frame at the scans' times. Other pads read 0.
    """
    layout = sensor.layout
    if pad not in layout.pads[: layout.pad_count]:
        raise NameUnknown("pad", pad, layout.pads[: layout.pad_count])
    number = layout.pads.index(pad)
    t_s = np.arange(pressing.course.scans) / pressing.rate_hz
    delay_s = delays(pressing.faults, layout, number, pressing.rate_hz)
    pressure = _as_read(_Press(pressing, foundation_of(layout, number, pressing.skin)), t_s, delay_s)
    own = layout.of_pad(number)
    values = np.zeros((len(t_s), layout.taxels))
    scale = _full_scale(sensor, pressing) / pressing.faults.full_scale_pa
    values[:, own] = scale * readings(pressing.faults, layout, number, pressure, pressing.rate_hz, pressing.seed)
    if sensor.unit == "count" and pressing.faults.bits:
        values = np.round(values)
    scans = RawScans(t_s, sensor.channel_map.to_source(values))
    if delay_s.any() and not sensor.delay_s:
        whole = np.zeros(layout.taxels)
        whole[own] = delay_s
        sensor = msgspec.structs.replace(sensor, delay_s=tuple(whole.tolist()))
    path = follow(pressing.course, pressing.rate_hz, t_s)
    truth = Truth(pad, t_s, path.pose, path.slides | path.turns)
    name = f"pressed {pressing.object.shape}, seed {pressing.seed}"
    return Recording(name, "rig", sensor, lambda: cut_up(scans), scans=len(t_s), truth=truth)


def pressed_along(
    pressing: Pressing, layout: Layout, pad: int, t_s: Floats, path: Callable[[Floats], Followed]
) -> Floats:
    """Pressure (scans, taxels of the pad) in Pa, without faults, of an object that is moved along a path."""
    press = _Press(pressing, foundation_of(layout, pad, pressing.skin), path)
    own = layout.of_pad(pad)
    return press.read(press.pressures(t_s), np.ones(own.stop - own.start, dtype=np.bool_))


def _full_scale(sensor: Sensor, pressing: Pressing) -> float:
    """The reading, in the sensor's unit, that stands for `full_scale_pa`."""
    if sensor.full_scale is not None:
        return sensor.full_scale
    if sensor.unit == "count":
        return float(2 ** (pressing.faults.bits or 12) - 1)
    return pressing.faults.full_scale_pa / sensor.to_si


class _Press:
    """An object on a skin, for one pad."""

    def __init__(self, pressing: Pressing, skin: Foundation, path: Callable[[Floats], Followed] | None = None) -> None:
        self._asked, self._skin, self._body = pressing, skin, body_of(pressing.object)
        self._follow = path or (lambda t_s: follow(pressing.course, pressing.rate_hz, t_s))
        middle = np.array([[*pressing.course.middle_m, pressing.course.angle_rad]])
        self._start = np.array([[2 * pressing.object.relief_m, 0.0, 0.0]])
        self._force_n = pressing.force_n or self._nominal(middle)
        self._start = self._settled(middle, np.array([[self._force_n, 0.0, 0.0]]), self._start)[1]

    def pressures(self, t_s: Floats) -> Floats:
        """Pressure (times, points) on the skin in Pa."""
        path = self._follow(t_s)
        lever = self._asked.object.lever_m * path.slides[:, np.newaxis] * path.ahead
        in_body = path.lever_m + np.einsum("kji,kj->ki", rotation(path.pose[:, 2]), lever)
        load = self._force_n * path.load[:, np.newaxis] * np.column_stack([np.ones(len(t_s)), in_body])
        start = self._start if len(self._start) == len(t_s) else np.repeat(self._start[:1], len(t_s), axis=0)
        pressure, self._start = self._settled(path.pose, load, start)
        return pressure

    def read(self, pressure: Floats, taxels: Bools) -> Floats:
        """What some taxels of the pad read (times, n) of pressures (times, points), Pa. taxels: (taxels,)."""
        found: Floats = (self._skin.weights[np.flatnonzero(taxels)] @ pressure.T).T
        return found

    def _nominal(self, middle: Floats) -> float:
        """The force in N that presses `peak_pa` on one taxel: doubled until it is above, then by bisection."""
        low, high = _SEARCH.least_n, np.inf
        for _ in range(30):
            force_n = 2 * low if high == np.inf else (low + high) / 2
            pressure, self._start = self._settled(middle, np.array([[force_n, 0.0, 0.0]]), self._start)
            above = float((self._skin.bare @ pressure[0]).max()) > self._asked.peak_pa
            low, high = (low, force_n) if above else (force_n, high)
        return force_n

    def _settled(self, pose: Floats, load: Floats, start: Floats) -> tuple[Floats, Floats]:
        """Pressures (times, points) and states (times, 3) at poses (times, 3) under loads (times, 3).

        start: (times, 3), states from which to search; those without load are given back as they are.
        """
        rows = np.column_stack([pose, load])
        distinct, chosen, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        pressure, state = np.zeros((len(distinct), len(self._skin.x_m))), start[chosen]
        loaded = np.flatnonzero(distinct[:, 3] > 0)
        near = self._body.near(self._skin.x_m, self._skin.y_m, distinct[loaded, :2])
        for some in np.array_split(loaded, max(1, -(-len(loaded) // _SEARCH.scans))):
            pressure[np.ix_(some, near)], state[some] = self._pressed(distinct[some], state[some], near)
        which = which.ravel()
        return pressure[which], state[which]

    def _pressed(self, asked: Floats, start: Floats, near: Indices) -> tuple[Floats, Floats]:
        """Pressures (times, n) on the points `near` and states (times, 3). asked: (times, 6), poses and loads."""
        skin, tilts, gap_m = self._asked.skin, self._asked.object.tilts, _SEARCH.gap * self._asked.object.relief_m
        sites = self._sites(asked[:, :3], near)
        touched = np.asarray((sites.height_m > -gap_m).any(axis=0))
        state = settle(skin, sites.at(touched), asked[:, 3:], start, tilts)
        depth = depths(sites, state)
        if (depth[:, ~touched] > 0).any():
            state = settle(skin, sites, asked[:, 3:], state, tilts)
            depth = depths(sites, state)
        return pressure_at(skin, depth), state

    def _sites(self, pose: Floats, near: Indices) -> Sites:
        """The relief at poses (times, 3) over some points of the skin. near: numbers of these points."""
        cos, sin = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
        dx, dy = self._skin.x_m[near] - pose[:, :1], self._skin.y_m[near] - pose[:, 1:2]
        u_m, v_m = cos * dx + sin * dy, cos * dy - sin * dx
        return Sites(self._body.height(u_m, v_m), u_m, v_m, self._skin.cell_m2)


def _as_read(press: _Press, t_s: Floats, delay_s: Floats) -> Floats:
    """Pressures (scans, taxels) in Pa, each at the time at which its taxel is read. delay_s: (taxels,)."""
    found = np.empty((len(t_s), len(delay_s)))
    for late_s in np.unique(delay_s):
        found[:, delay_s == late_s] = press.read(press.pressures(t_s + late_s), delay_s == late_s)
    return found
