"""How far the object has moved and turned since first contact: a rigid fit of all contacts, scan by scan."""

from __future__ import annotations

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.fusion.twist import COV_POSE, POSE, add_point, put_matrix, turn_is_seen
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.se2 import rotate, rotate_back
from taxelflow.numerics.small_linalg import inverse2, inverse3

# Memory per pad: whether anchored, the contact's place on the object (2), its covariance (4), the turn it started at.
_ANCHORED, _POINT, _POINT_COV, _SPIN, MEMORY = 0, 1, 3, 7, 8
# Of the object: whether in contact, pose (3), covariance (9).
_TOUCHED, _POSE, _COV = 0, 1, 4
_ROUNDS = 4
_TINY_M2 = 1e-18


@kernel
def follow_pose(
    place: Floats,
    place_cov: Floats,
    spin: Floats,
    touching: Bools,
    any_contact: Bools,
    turns: bool,
    memory: Floats,
    body: Floats,
    rows: Floats,
) -> None:
    """Fill the pose's columns of rows (scans, COLUMNS), which come in as NaN.

    place: (scans, pads, 2) in the hand. place_cov: (scans, pads, 2, 2). spin: (scans, pads, 2), the pad's own theta and
    its variance, NaN where the method has none. touching: (scans, pads), the place is known. any_contact: (scans,).
    memory: (pads, MEMORY) and body: (13,) are kept from scan to scan.
    A contact is anchored on the object where it first lies there; while nothing touches everything is forgotten.
    """
    for scan in range(place.shape[0]):
        if not any_contact[scan]:
            body[:] = 0.0
            memory[:] = 0.0
            continue
        if body[_TOUCHED] == 0.0:
            body[_TOUCHED] = 1.0
        seen = _fit(place[scan], place_cov[scan], spin[scan], touching[scan], turns, memory, body)
        for pad in range(place.shape[1]):
            if not touching[scan, pad]:
                memory[pad] = 0.0
            elif memory[pad, _ANCHORED] == 0.0:
                _anchor(place[scan, pad], place_cov[scan, pad], spin[scan, pad, 0], memory[pad], body)
        rows[scan, POSE : POSE + 2] = body[_POSE : _POSE + 2]
        rows[scan, COV_POSE : COV_POSE + 9] = body[_COV : _COV + 9]
        if seen or (body[_POSE + 2] == 0.0 and body[_COV + 8] == 0.0):
            rows[scan, POSE + 2] = body[_POSE + 2]
        else:
            for k in (2, 5, 6, 7, 8):
                rows[scan, COV_POSE + k] = np.nan


@kernel
def _fit(
    place: Floats, place_cov: Floats, spin: Floats, touching: Bools, turns: bool, memory: Floats, body: Floats
) -> bool:
    """Gauss-Newton for the object's pose from all anchored contacts; whether its turn is seen."""
    seen = False
    for _ in range(_ROUNDS):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        cos, sin = np.cos(body[_POSE + 2]), np.sin(body[_POSE + 2])
        count = 0
        for pad in range(len(place)):
            m = memory[pad]
            if not touching[pad] or m[_ANCHORED] == 0.0:
                continue
            count += 1
            x, y = rotate(cos, sin, m[_POINT], m[_POINT + 1])
            cov = place_cov[pad] + m[_POINT_COV : _POINT_COV + 4].reshape(2, 2)
            left_x, left_y = place[pad, 0] - x - body[_POSE], place[pad, 1] - y - body[_POSE + 1]
            add_point(normal, right, inverse2(cov, _TINY_M2), x, y, left_x, left_y)
            if spin[pad, 1] > 0.0 and np.isfinite(m[_SPIN]):
                normal[2, 2] += 0.5 / spin[pad, 1]
                right[2] += 0.5 * (spin[pad, 0] - m[_SPIN] - body[_POSE + 2]) / spin[pad, 1]
        if count == 0:
            return False
        seen = turns and turn_is_seen(normal)
        if seen:
            covariance = inverse3(normal)
            step = covariance @ right
            put_matrix(body, _COV, covariance)
        else:
            flat = inverse2(normal, 0.0)
            step = np.zeros(3)
            step[:2] = flat @ right[:2]
            put_matrix(body, _COV, flat)
            if body[_COV + 8] == 0.0:
                body[_COV + 8] = np.inf
        body[_POSE : _POSE + 3] += step
        if np.abs(step).max() < 1e-12:
            break
    return seen


@kernel
def _anchor(place: Floats, place_cov: Floats, theta: float, m: Floats, body: Floats) -> None:
    """Note where on the object a new contact lies, given where the object is now."""
    cos, sin = np.cos(body[_POSE + 2]), np.sin(body[_POSE + 2])
    x, y = place[0] - body[_POSE], place[1] - body[_POSE + 1]
    m[_ANCHORED] = 1.0
    m[_POINT], m[_POINT + 1] = rotate_back(cos, sin, x, y)
    m[_POINT_COV : _POINT_COV + 4] = np.ascontiguousarray(place_cov).reshape(4)
    m[_SPIN] = theta - body[_POSE + 2]
