"""What any estimator of translation owes to the object it looks at, whatever the pressure pattern."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from synthetic import METHODS, assert_same, grid_sensor, pieces, scans_of, slips_by
from taxelflow.messages import Floats, Scans, Slips

PITCH = 0.01
both_methods = pytest.mark.parametrize("method", METHODS)


@st.composite
def patterns(draw: st.DrawFn, most: int = 4) -> Floats:
    """A small patch of pressure with one clear maximum."""
    rows, cols = draw(st.integers(1, most)), draw(st.integers(1, most))
    seed = draw(st.integers(0, 2**32 - 1))
    patch: Floats = np.random.default_rng(seed).integers(1, 1000, (rows, cols)).astype(float)
    patch.ravel()[draw(st.integers(0, patch.size - 1))] = 1500.0
    return patch


@st.composite
def images(draw: st.DrawFn, scans: int = 6) -> Floats:
    """Unrelated random scans of one pad (scans, rows, cols), each with one clear maximum."""
    rows, cols = draw(st.integers(1, 8)), draw(st.integers(1, 8))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    drawn: Floats = random.integers(0, 1000, (scans, rows, cols)).astype(float)
    for image in drawn:
        image[random.integers(rows), random.integers(cols)] = 1500.0
    return drawn


def placed(patch: Floats, row: int, col: int, shape: tuple[int, int]) -> Floats:
    image = np.zeros(shape)
    image[row : row + patch.shape[0], col : col + patch.shape[1]] = patch
    return image


def seen(method: str, pictures: Any, **more: Any) -> Slips:
    """Slips of one pad from (scans, rows, cols)."""
    stack = np.asarray(pictures)
    sensor = grid_sensor(*stack.shape[1:], pitch_m=(PITCH, PITCH))
    return slips_by(method, sensor, scans_of(sensor, stack.reshape(len(stack), -1), **more))


def close(one: Floats, other: Floats) -> None:
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


@both_methods
@given(pictures=images(scans=1), scans=st.integers(3, 8))
def test_no_motion_is_exactly_no_slip(method: str, pictures: Floats, scans: int) -> None:
    slips = seen(method, np.repeat(pictures, scans, axis=0))
    assert slips.valid[2:].all()
    np.testing.assert_array_equal(slips.displacement[slips.valid][..., :2], 0)
    np.testing.assert_array_equal(slips.velocity[slips.valid][..., :2], 0)


@both_methods
@given(patch=patterns(), start=st.tuples(*[st.integers(0, 6)] * 2), end=st.tuples(*[st.integers(0, 6)] * 2))
def test_a_shift_by_k_taxels_is_k_pitches(
    method: str, patch: Floats, start: tuple[int, int], end: tuple[int, int]
) -> None:
    before, after = (placed(patch, *place, (10, 10)) for place in (start, end))
    slips = seen(method, [before, before, after, after])
    total = np.nansum(slips.displacement[:, 0, :2], axis=0)
    close(total, PITCH * np.array([end[1] - start[1], start[0] - end[0]]))
    if method == "convolution":  # half a scan late: each half of the step shows in one scan
        close(slips.displacement[2, 0, :2], slips.displacement[3, 0, :2])


@both_methods
@given(patch=patterns(), start=st.tuples(*[st.integers(0, 6)] * 2), end=st.tuples(*[st.integers(0, 6)] * 2))
def test_a_shift_by_k_taxels_moves_the_position_by_k_pitches(
    method: str, patch: Floats, start: tuple[int, int], end: tuple[int, int]
) -> None:
    before, after = (placed(patch, *place, (10, 10)) for place in (start, end))
    slips = seen(method, [before, before, after, after])
    moved = slips.pose[3, 0, :2] - slips.pose[1, 0, :2]
    close(moved, PITCH * np.array([end[1] - start[1], start[0] - end[0]]))


@both_methods
@given(pictures=images())
def test_a_mirror_turns_left_and_right_about(method: str, pictures: Floats) -> None:
    slips, mirrored = seen(method, pictures), seen(method, pictures[:, :, ::-1])
    for part in ("pose", "displacement"):
        close(getattr(mirrored, part)[..., :2], getattr(slips, part)[..., :2] * [-1, 1])


@both_methods
@given(pictures=images())
def test_a_mirror_turns_up_and_down_about(method: str, pictures: Floats) -> None:
    slips, mirrored = seen(method, pictures), seen(method, pictures[:, ::-1])
    for part in ("pose", "displacement"):
        close(getattr(mirrored, part)[..., :2], getattr(slips, part)[..., :2] * [1, -1])


@both_methods
@given(pictures=images(), quarters=st.integers(1, 3))
def test_a_quarter_turn_of_the_scan_turns_the_answer(method: str, pictures: Floats, quarters: int) -> None:
    slips, turned = seen(method, pictures), seen(method, np.rot90(pictures, quarters, axes=(1, 2)))
    angle = quarters * np.pi / 2
    turn = np.round([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for part in ("pose", "displacement"):
        close(getattr(turned, part)[..., :2], getattr(slips, part)[..., :2] @ turn.T)


@both_methods
@given(pictures=images(), quarters=st.integers(1, 3))
def test_a_quarter_turn_turns_the_covariance(method: str, pictures: Floats, quarters: int) -> None:
    slips = seen(method, pictures, noise=30.0)
    turned = seen(method, np.rot90(pictures, quarters, axes=(1, 2)), noise=30.0)
    angle = quarters * np.pi / 2
    turn = np.round([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for part in ("covariance", "displacement_covariance"):
        close(getattr(turned, part)[..., :2, :2], turn @ getattr(slips, part)[..., :2, :2] @ turn.T)


@both_methods
@given(pictures=images(scans=8))
def test_reversed_time_flips_the_sign(method: str, pictures: Floats) -> None:
    forth, back = seen(method, pictures), seen(method, pictures[::-1])
    known = forth.displacement[forth.valid][..., :2]
    np.testing.assert_array_equal(back.displacement[back.valid][..., :2], -known[::-1])


@both_methods
@given(pictures=images(), scale=st.floats(1e-6, 1e6))
def test_the_scale_of_pressure_changes_nothing(method: str, pictures: Floats, scale: float) -> None:
    slips, scaled = seen(method, pictures, noise=20.0), seen(method, scale * pictures, noise=scale * 20.0)
    for part in ("pose", "displacement", "covariance", "displacement_covariance"):
        close(getattr(scaled, part), getattr(slips, part))


@both_methods
@given(pictures=images(), loads=st.lists(st.floats(0.01, 100.0), min_size=6, max_size=6))
def test_a_load_that_changes_over_an_empty_background_moves_nothing(
    method: str, pictures: Floats, loads: list[float]
) -> None:
    still = np.array([load * pictures[0] for load in loads])
    slips = seen(method, still)
    np.testing.assert_allclose(slips.displacement[slips.valid][..., :2], 0, rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", [*METHODS, "sum"])
@given(
    seed=st.integers(0, 2**32 - 1),
    cuts=st.lists(st.integers(0, 30), max_size=12),
    modes=st.tuples(*[st.sampled_from(["batch", "stream"])] * 2),
)
@example(seed=2, cuts=[*range(30)], modes=("batch", "stream"))
def test_modes_and_blocks_give_the_same_bits(method: str, seed: int, cuts: list[int], modes: tuple[str, str]) -> None:
    random = np.random.default_rng(seed)
    sensor = grid_sensor(3, 4, pads=3)
    scans = scans_of(
        sensor,
        random.normal(1, 1, (30, 36)),
        t_s=np.cumsum(random.uniform(0.01, 1, 30)),
        noise=random.choice([0.0, 0.1, 0.3], 36, p=[0.1, 0.5, 0.4]),
        contact=random.random((30, 3)) < 0.85,
        complete=random.random((30, 3)) < 0.9,
    )
    whole = slips_by(method, sensor, scans, mode=modes[0])
    assert_same(slips_by(method, sensor, *pieces(scans, cuts), mode=modes[1]), whole)


def between(patch: Floats, place: float, shape: tuple[int, int]) -> Floats:
    """The patch at a place between taxels, as area-averaging taxels see a pattern that is linear between knots."""
    col = int(place)
    share = place - col
    return (1 - share) * placed(patch, 2, col, shape) + share * placed(patch, 2, col + 1, shape)


@given(
    patch=patterns(),
    steps_s=st.lists(st.floats(0.02, 0.5), min_size=3, max_size=10),
    velocity=st.floats(-0.06, 0.06),
)
def test_a_constant_velocity_comes_out_exactly_at_irregular_times(
    patch: Floats, steps_s: list[float], velocity: float
) -> None:
    t_s = np.cumsum([0.0, *steps_s])
    way = velocity * t_s / PITCH
    places = way - min(way.min(), 0.0)
    shape = (8, int(places.max()) + 8)
    assume(shape[1] < 60)
    pictures = [between(patch, float(place), shape) for place in places]
    slips = seen("convolution", pictures, t_s=t_s)
    np.testing.assert_allclose(slips.velocity[2:, 0, 0], velocity, rtol=0, atol=1e-10)
    np.testing.assert_allclose(slips.velocity[2:, 0, 1], 0, rtol=0, atol=1e-10)


@given(patch=patterns(), steps=st.lists(st.tuples(st.integers(1, 4), st.floats(0.02, 0.5)), min_size=2, max_size=8))
def test_the_largest_taxel_has_the_velocity_of_its_steps(patch: Floats, steps: list[tuple[int, float]]) -> None:
    t_s = np.cumsum([0.0, *(seconds for _, seconds in steps)])
    places = np.cumsum([0, *(taxels for taxels, _ in steps)])
    pictures = [placed(patch, 2, int(place), (8, 40)) for place in places]
    slips = seen("lnorm", pictures, t_s=t_s)
    expected = [taxels * PITCH / seconds for taxels, seconds in steps]
    np.testing.assert_allclose(slips.velocity[1:, 0, 0], expected, rtol=1e-9)


@both_methods
@given(seed=st.integers(0, 2**32 - 1))
def test_covariances_are_symmetric_and_never_negative(method: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    sensor = grid_sensor(4, 5)
    scans = scans_of(sensor, random.random((8, 20)) + 0.1, noise=random.uniform(0.01, 0.2, 20))
    slips = slips_by(method, sensor, scans)
    for matrix in (slips.covariance[2:, 0, :2, :2], slips.displacement_covariance[2:, 0, :2, :2]):
        np.testing.assert_array_equal(matrix, np.swapaxes(matrix, 1, 2))
        assert (np.linalg.eigvalsh(matrix) >= -1e-18).all()


@both_methods
@given(contact=st.lists(st.booleans(), min_size=3, max_size=40), seed=st.integers(0, 100))
def test_no_displacement_spans_a_gap_in_contact(method: str, contact: list[bool], seed: int) -> None:
    random = np.random.default_rng(seed)
    sensor = grid_sensor(3, 3)
    scans: Scans = scans_of(sensor, random.random((len(contact), 9)), contact=contact)
    slips = slips_by(method, sensor, scans)
    needed = {"lnorm": (1, 2), "convolution": (2, 3)}[method]
    run = 0
    for scan, touched in enumerate(contact):
        run = run + 1 if touched else 0
        assert bool(np.isfinite(slips.pose[scan, 0, 0])) == (run >= needed[0])
        assert bool(slips.valid[scan, 0]) == (run >= needed[1])
