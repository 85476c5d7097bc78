from __future__ import annotations

import numpy as np
import pytest

from taxelflow.fusion.in_hand import Carrier, Home
from taxelflow.fusion.reference import UNOBSERVABLE_M, UNOBSERVABLE_M_S
from taxelflow.fusion.session import nothing
from taxelflow.geometry import rotation
from taxelflow.messages import AMBIGUOUS, OK, Floats, Slips, Texture

PADS, SCANS = 5, 40


def _product(A: Floats, B: Floats) -> Floats:
    """Of stacks of matrices (2, 2); `@` is rounded as the machine's library does it."""
    summed: Floats = A[..., :, 0:1] * B[..., 0:1, :] + A[..., :, 1:] * B[..., 1:, :]
    return summed


def twin(slips: Slips, point: Floats, texture: Texture | None, home: Home) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """What `Carrier` gives, in NumPy."""
    moved = slips.displacement[..., :2]
    own = np.stack([slips.covariance[..., :2, :2], slips.displacement_covariance[..., :2, :2]])
    doubt = home.doubt * (slips.border & (slips.quality == AMBIGUOUS)[..., np.newaxis])
    most = np.fmax.reduce(np.hypot(moved[..., 0], moved[..., 1]), axis=1, initial=0.0)
    for axis in range(2):
        own[0, ..., axis, axis] += (doubt[..., axis] * home.pitch[:, axis]) ** 2
        own[1, ..., axis, axis] += (doubt[..., axis] * most[:, np.newaxis]) ** 2
    turns = [
        np.stack([v[..., 2], c[..., 2, 2]], axis=-1)
        for v, c in ((slips.displacement, slips.displacement_covariance), (slips.pose, slips.covariance))
    ]
    if texture is not None:
        span_s = np.nan_to_num(slips.span_s)[..., np.newaxis, np.newaxis]
        own[0] += UNOBSERVABLE_M**2 * texture.unobservable
        own[1] += (UNOBSERVABLE_M_S * span_s) ** 2 * texture.unobservable
        for turn in turns:
            turn[~texture.turns] = np.nan
    place = np.einsum("pij,spj->spi", home.R, point) + home.origin
    held = slips.contact & home.used
    told = np.isfinite(place[..., 0]) & held
    carried = [place, np.einsum("pij,spj->spi", home.R, moved), *turns]
    flags = [slips.valid & home.used, told, held & (slips.valid | ~told)]
    return [*carried, *flags], list(_product(_product(home.R, own), home.R.transpose(0, 2, 1)))


@pytest.mark.parametrize("textured", [True, False])
def test_slips_are_carried_to_the_hand_as_in_numpy_to_the_bit(textured: bool) -> None:
    rng = np.random.default_rng(3)
    shape = (SCANS, PADS)
    unknown = rng.random(shape) < 0.2
    roots = rng.normal(size=(2, *shape, 3, 3))
    covariance, displacement, pose = (
        roots @ roots.swapaxes(-1, -2),
        rng.normal(size=(*shape, 3)),
        rng.normal(size=(*shape, 3)),
    )
    displacement[unknown] = pose[rng.random(shape) < 0.2] = covariance[0][rng.random(shape) < 0.1] = np.nan
    displacement[0] = 0.0
    span = np.where(unknown, np.nan, 0.01)
    slips = Slips(
        np.arange(SCANS) * 0.01,
        rng.random(shape) < 0.8,
        rng.random((*shape, 2)) < 0.4,
        displacement,
        pose,
        covariance[0],
        covariance[1],
        span,
        span,
        span,
        span,
        rng.choice([OK, AMBIGUOUS], shape).astype(np.uint8),
    )
    texture = Texture(slips.t_s, unknown, rng.random(shape) < 0.7, rng.random((*shape, 2, 2))) if textured else None
    used = np.array([True, True, False, True, True])
    home = Home(rotation(rng.uniform(-3, 3, PADS)), rng.normal(size=(PADS, 2)), rng.random((PADS, 2)), used, 0.3)
    point = pose[..., :2] + 0.1
    found, *covariances = Carrier(home).step(slips, point, texture)
    carried, spread = twin(slips, point, texture, home)
    for own, other in zip([*found, *covariances], [*carried, *spread], strict=True):
        assert own.dtype == other.dtype
        if own.dtype.kind == "f":
            own[np.isnan(own)] = other[np.isnan(other)] = np.nan  # whatever its sign
        assert own.tobytes() == np.ascontiguousarray(other).tobytes()


def test_nothing_is_carried_to_nothing() -> None:
    home = Home(rotation(np.zeros(2)), np.zeros((2, 2)), np.ones((2, 2)), np.ones(2, dtype=np.bool_), 0.3)
    found, *_ = Carrier(home).step(nothing(2), np.zeros((0, 2, 2)), None)
    assert all(not len(part) for part in found)
