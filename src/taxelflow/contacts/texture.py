"""Texture of a contact's pattern, which decides what motion of the object's surface is observable.

The pattern of a smooth round object shows where it touches, but not how its surface moves: if it rolls or spins in
place, the pattern stays. Texture is what the laws of smooth contact (`smooth_laws`) leave of a pattern, less the noise.
A direction in which the pattern has no gradient beyond that of noise is not observable, as along a ridge that crosses
the pad.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from taxelflow.contacts.smooth_laws import TERMS, Scratch, fit_smooth, room_for
from taxelflow.messages import Bools, Floats, Scans, Texture
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.records import Records, records
from taxelflow.numerics.rounding import REACH, ROUNDING
from taxelflow.numerics.small_linalg import inverse2
from taxelflow.runtime.compiling import kernel, routine
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.sensors.layout import Layout


class _Texture(NamedTuple):
    """When texture is looked for, and what is one."""

    every: int = 8
    """Scans of a contact between two evaluations: texture changes slowly."""
    memory: float = 0.9
    """Factor on the sums per evaluation: they reach back over about 80 scans."""
    share: float = 0.05
    """Least share of the gradient's energy that is texture; each of the four laws leaves less than 0.03 of the
    others."""
    observable: float = 5.0
    """Energy of the gradient over that of noise above which a direction is observable: 0.2 pitches by one scan."""


_TEXTURE = _Texture()


class Gradients(NamedTuple):
    """Gradient at taxel k, of the plane through it and its neighbours: sum of (along_x, along_y) times the differences
    to others[first[k] : first[k + 1]]. own: (entries, 2), variance of each component per variance of a reading.
    """

    first: NDArray[np.int64]
    others: NDArray[np.int64]
    along_x: Floats
    along_y: Floats
    own: Floats


class Sums:
    """Fading sums over the last evaluations of a contact.

    xx, xy, yy: energy of the gradient. noise_x, noise_y: of the noise in it. texture: of the texture alone. arm:
    energy of the gradient times the distance from the point about which a rotation changes the pattern least; turn:
    the part of it that a rotation changes. count: evaluations. age: scans since the contact began. smooth, turns,
    unobservable: results, see `Texture`.
    """

    age: int
    smooth: bool
    turns: bool
    unobservable: Annotated[Floats, 2, 2]
    count: float
    xx: float
    xy: float
    yy: float
    noise_x: float
    noise_y: float
    texture: float
    arm: float
    turn: float


class TextureMeter:
    """Evaluates contacts scan by scan, with sums for each."""

    def __init__(self, layout: Layout) -> None:
        self._starts = layout.starts
        self._xy = np.stack([layout.x_m, layout.y_m])
        self._gradients = gradients_of(layout)
        self._error = layout.unseen_error
        self._sums = records(Sums, len(layout.pads))
        self._measure = Settled(measure)
        self._scratch = room_for(int(np.diff(layout.starts).max()))

    def step(self, scans: Scans) -> Texture:
        """Texture of all pads."""
        shape = scans.contact.shape
        smooth, turns, unobservable = (
            np.zeros(shape, dtype=np.bool_),
            np.zeros(shape, dtype=np.bool_),
            np.zeros((*shape, 2, 2)),
        )
        self._measure(
            (scans.pressure, scans.noise, scans.contact, scans.contact & scans.complete),
            self._xy,
            self._starts,
            self._gradients,
            self._error,
            self._scratch,
            self._sums,
            (smooth, turns, unobservable),
        )
        return Texture(scans.t_s, smooth, turns, unobservable)


@kernel
def measure(
    block: tuple[Floats, Floats, Bools, Bools],
    xy: Floats,
    starts: NDArray[np.int64],
    gradients: Gradients,
    error: float,
    scratch: Scratch,
    sums: Records,
    out: tuple[Bools, Bools, Floats],
) -> None:
    """Fill out: smooth and turns (scans, pads), and unobservable (scans, pads, 2, 2), which come in as 0.

    block: pressure (scans, entries), noise (entries,), contact (scans, pads), and whether a scan can be evaluated
    (scans, pads). xy: (2, entries), m. error: relative, of readings. sums: (pads,) of `Sums`, kept from block to block.
    """
    pressure, noise, contact, usable = block
    smooth, turns, unobservable = out
    for pad in range(len(starts) - 1):
        own, begin, end = sums[pad], starts[pad], starts[pad + 1]
        for scan in range(pressure.shape[0]):
            if not contact[scan, pad]:
                own.age = 0
                own.xx = own.xy = own.yy = own.noise_x = own.noise_y = own.texture = own.arm = own.turn = own.count = (
                    0.0
                )
                continue
            evaluated = own.age % _TEXTURE.every == 0 and usable[scan, pad]
            if evaluated:
                add_scan(pressure[scan], noise, xy, (begin, end), gradients, error, scratch, own)
            if evaluated or own.age == 0:
                own.smooth = judge(own, own.unobservable)
                own.turns = not own.smooth or own.turn > _TEXTURE.share * own.arm
            own.age += 1
            smooth[scan, pad], turns[scan, pad] = own.smooth, own.turns
            for a in range(4):
                unobservable[scan, pad, a // 2, a % 2] = own.unobservable[a // 2, a % 2]


@routine
def judge(own: Sums, unobservable: Floats) -> bool:
    """Whether the contact is smooth; fill what is not observable (2, 2), see `Texture`."""
    half, apart = 0.5 * (own.xx - own.yy), own.xy
    middle, radius = 0.5 * (own.xx + own.yy), np.hypot(half, apart)
    angle = 0.5 * np.arctan2(apart, half)
    x, y = np.cos(angle), np.sin(angle)  # of the direction that is observed best
    along, across = x * x * own.noise_x + y * y * own.noise_y, y * y * own.noise_x + x * x * own.noise_y
    for a in range(4):
        unobservable[a // 2, a % 2] = 0.0
    if middle - radius < _TEXTURE.observable * across:
        tilt = across / (own.count * (middle + radius)) if middle + radius > _TEXTURE.observable * along else 1.0
        unobservable[0, 0] = y * y + tilt * x * x
        unobservable[1, 1] = x * x + tilt * y * y
        unobservable[0, 1] = unobservable[1, 0] = (tilt - 1.0) * x * y
    all_of_it = own.xx + own.yy - own.noise_x - own.noise_y
    return bool(own.texture < _TEXTURE.share * all_of_it or not all_of_it > 0.0)


@routine
def add_scan(
    pressure: Floats,
    noise: Floats,
    xy: Floats,
    taxels: tuple[int, int],
    gradients: Gradients,
    error: float,
    scratch: Scratch,
    own: Sums,
) -> None:
    """Add a scan's energies to the sums of its contact."""
    begin, end = taxels
    loaded = fit_smooth(pressure[begin:end], noise[begin:end], xy[0, begin:end], xy[1, begin:end], scratch)
    if loaded == 0:
        return
    xx = xy_ = yy = noise_x = noise_y = rough = 0.0
    for k in range(begin, end):
        if not pressure[k] > LOADED.sigmas * noise[k]:
            continue
        gx, gy = gradient_at(k, pressure, noise, gradients, 0)
        rx, ry = gradient_at(k, scratch.rest, noise, gradients, begin)
        variance = noise[k] ** 2 + (error * pressure[k]) ** 2
        xx, xy_, yy = xx + gx * gx, xy_ + gx * gy, yy + gy * gy
        rough += rx * rx + ry * ry
        noise_x += variance * gradients.own[k, 0]
        noise_y += variance * gradients.own[k, 1]
    share = max(loaded - TERMS, 0) / loaded  # of the noise that the fit leaves
    kept = _TEXTURE.memory
    own.xx, own.xy, own.yy = kept * own.xx + xx, kept * own.xy + xy_, kept * own.yy + yy
    own.noise_x, own.noise_y = kept * own.noise_x + noise_x, kept * own.noise_y + noise_y
    own.texture = kept * own.texture + rough - share * (noise_x + noise_y)
    turn, arm = turn_energy(pressure, noise, xy, (begin, end), gradients, _TEXTURE.observable * (noise_x + noise_y))
    own.count = kept * own.count + 1.0
    own.turn, own.arm = kept * own.turn + turn, kept * own.arm + arm


@routine
def gradient_at(k: int, values: Floats, noise: Floats, gradients: Gradients, first: int) -> tuple[float, float]:
    """Gradient of values (entries from `first` on) at a taxel; a masked neighbour does not count."""
    x = y = 0.0
    for n in range(gradients.first[k], gradients.first[k + 1]):
        j = gradients.others[n]
        if noise[j] > 0.0:
            step = values[j - first] - values[k - first]
            x += gradients.along_x[n] * step
            y += gradients.along_y[n] * step
    return x, y


@routine
def turn_energy(
    pressure: Floats, noise: Floats, xy: Floats, own: tuple[int, int], gradients: Gradients, least: float
) -> tuple[float, float]:
    """Energy of a rotation about the point c where it is least, sum of ((r - c) x g)^2, and sum of |r - c|^2 |g|^2.

    About the centre of a round pattern the first is 0, even if the pad sees only a part of its rim. least: energy of
    the gradient from which it determines c in one direction.
    """
    begin, end = own
    aa = ab = bb = pa = pb = pp = rr_g = rx_g = ry_g = 0.0
    for k in range(begin, end):
        if pressure[k] > LOADED.sigmas * noise[k]:
            gx, gy = gradient_at(k, pressure, noise, gradients, 0)
            x, y = xy[0, k] - xy[0, begin], xy[1, k] - xy[1, begin]
            along, square = x * gy - y * gx, gx * gx + gy * gy
            aa, ab, bb = aa + gy * gy, ab - gx * gy, bb + gx * gx
            pa, pb, pp = pa + gy * along, pb - gx * along, pp + along * along
            rr_g, rx_g, ry_g = rr_g + (x * x + y * y) * square, rx_g + x * square, ry_g + y * square
    whole = aa + bb
    if not whole > 0.0:
        return 0.0, 0.0
    xx, cross, yy = inverse2(aa + least, ab, bb + least)
    mx, my = rx_g / whole, ry_g / whole  # along a direction without gradient c lies at the gradient's middle
    qa, qb = pa - aa * mx - ab * my, pb - ab * mx - bb * my
    cx, cy = mx + xx * qa + cross * qb, my + cross * qa + yy * qb
    turn = pp - 2.0 * (cx * pa + cy * pb) + cx * cx * aa + 2.0 * cx * cy * ab + cy * cy * bb
    if turn <= ROUNDING * rr_g:  # as of a single taxel
        return 0.0, 0.0
    return turn, rr_g - 2.0 * (cx * rx_g + cy * ry_g) + (cx * cx + cy * cy) * whole


def gradients_of(layout: Layout) -> Gradients:
    """Gradients of all pads, groups and separate contacts; they are kept for the next session on the same layout."""
    pitch_m = tuple(float(np.max(pitch_m)) for pitch_m in layout.pitch_m)
    return _gradients(tuple(layout.starts.tolist()), layout.x_m.tobytes(), layout.y_m.tobytes(), pitch_m)


@lru_cache(maxsize=16)
def _gradients(starts: tuple[int, ...], x_m: bytes, y_m: bytes, pitch_m: tuple[float, ...]) -> Gradients:
    first, others, weights = [0], [], []
    places = np.stack([np.frombuffer(x_m), np.frombuffer(y_m)], axis=1)
    own = np.zeros((len(places), 2))
    for start, stop, pitch in zip(starts[:-1], starts[1:], pitch_m, strict=True):
        place = places[start:stop]
        near = REACH.neighbour * pitch
        for k, here in enumerate(place):
            beside = place - here
            who = np.flatnonzero((np.abs(beside).max(axis=1) <= near) & (np.arange(len(place)) != k))
            plane = np.vstack(
                [np.zeros(2), beside[who]]
            )  # through its own height; otherwise curvature at a border would tilt it
            weight = np.linalg.pinv(plane - plane.mean(axis=0))
            others.append(who + start)
            weights.append(weight[:, 1:])
            own[start + k] = (weight**2).sum(axis=1)
            first.append(first[-1] + len(who))
    along = np.concatenate([*weights, np.zeros((2, 0))], axis=1)
    return Gradients(
        np.array(first),
        np.concatenate([*others, np.zeros(0, dtype=np.int64)]),
        np.ascontiguousarray(along[0]),
        np.ascontiguousarray(along[1]),
        own,
    )
