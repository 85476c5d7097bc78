"""Slips in the hand's frame: positions and motions of the contacts with covariances, and which contacts are used.

The kernel rounds each operation as NumPy does, which a test compares: so results do not depend on the size of a block.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.fusion.reference import UNOBSERVABLE_M, UNOBSERVABLE_M_S
from taxelflow.messages import AMBIGUOUS
from taxelflow.runtime.blocks import is_block
from taxelflow.runtime.compiling import exact_kernel, routine
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Bytes, Floats, Slips, Texture


class Home(NamedTuple):
    """Poses of the pads in the hand. R: (pads, 2, 2). origin, pitch: (pads, 2), m. used: (pads,), for the fusion.

    doubt: see `RigidField.edge_doubt`.
    """

    R: Floats
    origin: Floats
    pitch: Floats
    used: Bools
    doubt: float


class Carried(NamedTuple):
    """Slips in the hand. place, moved: (scans, pads, 2), position of the contact's point, and its displacement. turn,
    own_turn: (scans, pads, 2), rotation of the displacement and of the pose, each with its variance; NaN where the
    pattern does not show rotation. known, placed, kept: (scans, pads), whether the displacement is known, whether the
    position is, and whether the contact continues without a gap in its known motion.
    """

    place: Floats
    moved: Floats
    turn: Floats
    own_turn: Floats
    known: Bools
    placed: Bools
    kept: Bools


class Carrier:
    """Transforms slips into the hand's frame block by block, without memory."""

    def __init__(self, home: Home) -> None:
        self._home, self._fill = home, Settled(fill_carried)

    def step(
        self, slips: Slips, point: Floats, formed: Bools, texture: Texture | None
    ) -> tuple[Carried, Floats, Floats]:
        """Slips in the hand, with covariances (scans, pads, 2, 2) of position and displacement.

        point: (scans, pads, 2), see `Reference`. formed: (scans, pads), see `Forming`; others have no position.
        """
        if is_block(len(slips), fill_carried):
            return carry_block(slips, point, formed, texture, self._home)
        shape, home = slips.contact.shape, self._home
        room = np.empty((4, *shape, 2))
        flags = np.empty((3, *shape), dtype=np.bool_)
        out = Carried(room[0], room[1], room[2], room[3], flags[0], flags[1], flags[2])
        own = np.empty((2, *shape, 2, 2))
        placed = texture is not None
        turns, unobservable = (texture.turns, texture.unobservable) if texture is not None else (slips.contact, own[0])
        seen = (slips.displacement, slips.displacement_covariance, slips.pose, slips.covariance)
        marks = (slips.contact, slips.border, slips.quality, formed)
        self._fill(seen, marks, slips.span_s, point, (placed, turns, unobservable), home, own, out)
        return out, own[0], own[1]


def carry_block(
    slips: Slips, point: Floats, formed: Bools, texture: Texture | None, home: Home
) -> tuple[Carried, Floats, Floats]:
    """`Carrier.step` in NumPy, equal to the bit."""
    moved = slips.displacement[..., :2]
    own = np.stack([slips.covariance[..., :2, :2], slips.displacement_covariance[..., :2, :2]])
    doubt = home.doubt * (slips.border & (slips.quality == AMBIGUOUS)[..., np.newaxis])
    most = np.fmax.reduce(np.hypot(moved[..., 0], moved[..., 1]), axis=1, initial=0.0)
    for axis in range(2):
        own[0, ..., axis, axis] += (doubt[..., axis] * home.pitch[:, axis]) ** 2
        own[1, ..., axis, axis] += (doubt[..., axis] * most[:, np.newaxis]) ** 2
    seen = ((slips.displacement, slips.displacement_covariance), (slips.pose, slips.covariance))
    turn, own_turn = (np.stack([vector[..., 2], matrix[..., 2, 2]], axis=-1) for vector, matrix in seen)
    if texture is not None:
        span_s = np.nan_to_num(slips.span_s)[..., np.newaxis, np.newaxis]
        own[0] += UNOBSERVABLE_M**2 * texture.unobservable
        own[1] += (UNOBSERVABLE_M_S * span_s) ** 2 * texture.unobservable
        turn[~texture.turns] = own_turn[~texture.turns] = np.nan
    place = np.einsum("pij,spj->spi", home.R, point) + home.origin
    held = slips.contact & home.used
    placed = np.isfinite(place[..., 0]) & held & formed
    moved = np.einsum("pij,spj->spi", home.R, moved)
    carried = Carried(place, moved, turn, own_turn, slips.valid & home.used, placed, held & (slips.valid | ~placed))
    place_cov, moved_cov = _product(_product(home.R, own), home.R.transpose(0, 2, 1))
    return carried, place_cov, moved_cov


def _product(A: Floats, B: Floats) -> Floats:
    """Product of stacks of matrices (2, 2); the rounding of `@` depends on the machine's library."""
    summed: Floats = A[..., :, 0:1] * B[..., 0:1, :] + A[..., :, 1:] * B[..., 1:, :]
    return summed


@exact_kernel
def fill_carried(
    seen: tuple[Floats, Floats, Floats, Floats],
    marks: tuple[Bools, Bools, Bytes, Bools],
    span_s: Floats,
    point: Floats,
    texture: tuple[bool, Bools, Floats],
    home: Home,
    own: Floats,
    out: Carried,
) -> None:
    """Fill `Carried`, and the covariances own (2, scans, pads, 2, 2) of position and displacement in the hand's axes.

    seen: displacement and pose (scans, pads, 3), each with its covariance (scans, pads, 3, 3). marks: contact, border,
    quality and formed. texture: whether there is one, turns and unobservable.
    """
    moved, moved_cov, pose, pose_cov = seen
    contact, border, quality, formed = marks
    judged, turns, unobservable = texture
    scans, pads = contact.shape
    most = 0.0
    for row in range(scans * pads):
        scan, pad = row // pads, row % pads
        most = _largest(moved[scan]) if pad == 0 else most  # a border may hide as much motion as the largest
        R, span_ = home.R[pad], span_s[scan, pad]
        span = 0.0 if np.isnan(span_) else span_
        for a in range(2):
            out.place[scan, pad, a] = (
                0.0 + R[a, 0] * point[scan, pad, 0] + R[a, 1] * point[scan, pad, 1] + home.origin[pad, a]
            )
            out.moved[scan, pad, a] = 0.0 + R[a, 0] * moved[scan, pad, 0] + R[a, 1] * moved[scan, pad, 1]
        for k in range(4):
            a, b = k // 2, k % 2
            own[0, scan, pad, a, b] = pose_cov[scan, pad, a, b]
            own[1, scan, pad, a, b] = moved_cov[scan, pad, a, b]
            if a == b and border[scan, pad, a] and quality[scan, pad] == AMBIGUOUS:
                own[0, scan, pad, a, a] += (home.doubt * home.pitch[pad, a]) ** 2
                own[1, scan, pad, a, a] += (home.doubt * most) ** 2
            if judged:
                own[0, scan, pad, a, b] += UNOBSERVABLE_M**2 * unobservable[scan, pad, a, b]
                own[1, scan, pad, a, b] += (UNOBSERVABLE_M_S * span) ** 2 * unobservable[scan, pad, a, b]
        for k in range(2):  # R C R^T; the rounding of NumPy's product depends on the machine's library
            C = own[k, scan, pad]
            xx, xy, yx, yy = C[0, 0], C[0, 1], C[1, 0], C[1, 1]
            for a in range(2):
                x, y = R[a, 0] * xx + R[a, 1] * yx, R[a, 0] * xy + R[a, 1] * yy
                C[a, 0], C[a, 1] = x * R[0, 0] + y * R[0, 1], x * R[1, 0] + y * R[1, 1]
        shown = not judged or turns[scan, pad]
        out.turn[scan, pad, 0] = moved[scan, pad, 2] if shown else np.nan
        out.turn[scan, pad, 1] = moved_cov[scan, pad, 2, 2] if shown else np.nan
        out.own_turn[scan, pad, 0] = pose[scan, pad, 2] if shown else np.nan
        out.own_turn[scan, pad, 1] = pose_cov[scan, pad, 2, 2] if shown else np.nan
        valid = bool(np.isfinite(moved[scan, pad, 0]))
        held = contact[scan, pad] and home.used[pad]
        out.known[scan, pad] = valid and home.used[pad]
        out.placed[scan, pad] = held and formed[scan, pad] and np.isfinite(out.place[scan, pad, 0])
        out.kept[scan, pad] = held and (valid or not out.placed[scan, pad])


@routine
def _largest(moved: Floats) -> float:
    """Length of the largest displacement, m, of those (pads, 3) that are known."""
    most = 0.0
    for pad in range(len(moved)):
        most = np.fmax(most, np.hypot(moved[pad, 0], moved[pad, 1]))
    return most
