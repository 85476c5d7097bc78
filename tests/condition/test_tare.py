from __future__ import annotations

import numpy as np
import pytest

from costly import mostly_long
from synthetic import conditioned, dome, grid_sensor
from taxelflow.condition.resting import near_taxels
from taxelflow.condition.tare import Offsets, estimate_offset, find_offsets, idle_windows, is_unstructured
from taxelflow.messages import Bools, Floats

# The rules one by one, each just inside and just outside its threshold

SQUARE = grid_sensor(6, 6).layout
PAIRS = SQUARE.neighbours(0)
ALL = np.zeros(36, dtype=np.bool_)
CHECKERBOARD: Floats = np.where((SQUARE.row + SQUARE.col) % 2, 1.0, -1.0)
STRIPES: Floats = np.where(SQUARE.col < 3, 1.0, -1.0)
CORNER = 0


def geary_ratio(offset: Floats) -> float:
    one, other = offset[PAIRS].T
    return float(((one - other) ** 2).mean() / 2 / offset.var())


def of_roughness(least: float, most: float, corner_sigmas: float = 1 / 1.4826) -> Floats:
    """18 offsets of 1 and 18 of -1 with a Geary ratio in this range. The median is 0, the robust standard deviation is
    1.4826; one corner may lie farther out.
    """
    random = np.random.default_rng(0)
    offset = np.where(np.arange(36) == CORNER, corner_sigmas * 1.4826, STRIPES)
    for _ in range(1000):
        if least <= geary_ratio(offset) <= most:
            return offset
        swapped = offset.copy()
        swapped[random.choice(np.flatnonzero(offset == 1.0)[1:])] = -1.0
        swapped[random.choice(np.flatnonzero(offset == -1.0))] = 1.0
        if geary_ratio(swapped) <= most:
            offset = swapped
    raise AssertionError("no such offsets")


def accepted(offset: Floats, std: float = 1e-3, masked: Bools = ALL) -> bool:
    return is_unstructured(offset, masked, PAIRS, std)


@pytest.mark.parametrize(("ratio", "unstructured"), [((0.46, 0.49), False), ((0.51, 0.54), True)])
def test_neighbours_must_differ_by_half_of_what_random_taxels_do(
    ratio: tuple[float, float], unstructured: bool
) -> None:
    assert accepted(of_roughness(*ratio)) == unstructured


@pytest.mark.parametrize(
    ("sigmas", "ratio", "unstructured"),
    [
        (4.4, (0.55, 0.65), True),
        (4.6, (0.55, 0.65), False),
        (4.6, (0.77, 0.8), False),
        (4.6, (0.8, 0.83), True),
        (5.9, (0.8, 0.83), True),
    ],
)
def test_a_pad_with_a_suspect_taxel_must_be_rougher(
    sigmas: float, ratio: tuple[float, float], unstructured: bool
) -> None:
    assert accepted(of_roughness(*ratio, sigmas)) == unstructured


@pytest.mark.parametrize("mean", [0.0, 500.0])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("sigmas", "unstructured"), [(5.9, True), (6.1, False)])
def test_an_outlier_is_beyond_six_robust_standard_deviations(
    sigmas: float, unstructured: bool, sign: int, mean: float
) -> None:
    offset = CHECKERBOARD.copy()
    offset[np.flatnonzero(offset == sign)[7]] = sign * sigmas * 1.4826
    assert accepted(mean + offset) == unstructured


@pytest.mark.parametrize(("sigmas", "unstructured"), [(5.9, True), (6.1, False)])
def test_an_outlier_is_also_beyond_the_offsets_own_noise(sigmas: float, unstructured: bool) -> None:
    offset = np.zeros(36)
    offset[14] = sigmas
    assert accepted(offset, std=1.0) == unstructured


@pytest.mark.parametrize(("spread", "unstructured"), [(1.9, True), (2.1, False)])
def test_an_offset_within_its_own_noise_is_flat_whatever_its_shape(spread: float, unstructured: bool) -> None:
    assert accepted(STRIPES * spread, std=1.0) == unstructured


@pytest.mark.parametrize(("taxels", "unstructured"), [(8, False), (9, True)])
def test_a_pad_of_few_neighbours_cannot_be_judged_by_its_shape(taxels: int, unstructured: bool) -> None:
    neighbours = np.stack([np.arange(taxels - 1), np.arange(1, taxels)], axis=1)
    high = np.full(taxels, 100.0)
    assert is_unstructured(high, np.zeros(taxels, dtype=np.bool_), neighbours, 1.0) == unstructured
    masked = np.zeros(taxels + 1, dtype=np.bool_)
    masked[-1] = True  # a pair with a masked taxel does not count
    more = np.concatenate([neighbours, [[taxels - 1, taxels]]])
    assert is_unstructured(np.append(high, -500.0), masked, more, 1.0) == unstructured


@pytest.mark.parametrize(("level", "found"), [(5.9, True), (-5.9, True), (6.1, False), (-6.1, False)])
def test_a_pad_of_few_neighbours_is_idle_only_within_its_noise(level: float, found: bool) -> None:
    """Two windows of 12 scans; the standard deviation of the mean is that of the noisiest taxel."""
    noise = np.array([0.1, 0.5, 1.0, 0.1])
    windows = np.full((2, 12, 4), level / 24**0.5)
    neighbours = np.array([[0, 1], [1, 2], [2, 3]])
    masked = np.zeros(4, dtype=np.bool_)
    offset = estimate_offset(idle_windows(windows, noise, masked), noise, masked, neighbours, 1e3)
    assert (offset is not None) == found


def offset_of(windows: Floats, noise: float = 1.0, scale: float = 1e6) -> Floats | None:
    each = np.full(36, noise)
    return estimate_offset(idle_windows(windows, each, ALL), each, ALL, PAIRS, scale)


@pytest.mark.parametrize(("change", "idle"), [(5.5, True), (6.5, False)])
def test_a_window_in_which_a_taxel_changes_is_not_idle(change: float, idle: bool) -> None:
    """Feet on coarse taxels are as unstructured as offsets; while they slide their taxels change."""
    window = np.tile(100.0 * CHECKERBOARD, (1, 12, 1))
    window[:, 6:, 7] += change * np.sqrt(1 / 6 + 1 / 6)  # standard deviations of the difference of both halves
    assert (offset_of(window, scale=np.inf) is not None) == idle


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("share", "found"), [(0.099, True), (0.101, False)])
def test_an_offset_is_below_a_tenth_of_the_full_scale(share: float, found: bool, sign: int) -> None:
    assert (offset_of(np.full((3, 12, 36), sign * share * 500.0), scale=500.0) is not None) == found


@pytest.mark.parametrize(("sigmas", "used"), [(5.9, True), (6.1, False)])
def test_windows_are_idle_within_six_standard_deviations_of_the_lowest_sum(sigmas: float, used: bool) -> None:
    windows = np.full((2, 12, 36), 100.0)
    more = sigmas * (36 / 12) ** 0.5 / 36  # standard deviation of a window's sum of means, shared by the taxels
    windows[1] += more
    offset = offset_of(windows)
    assert offset is not None
    np.testing.assert_allclose(offset, 100.0 + (more / 2 if used else 0.0), atol=1e-6)


@pytest.mark.parametrize(("missing", "found"), [(5, True), (6, False)])
def test_a_window_of_a_pad_never_complete_needs_most_readings_of_each_taxel(missing: int, found: bool) -> None:
    windows = np.full((4, 12, 36), 100.0)
    windows[:, :missing, 7] = np.nan
    windows[:, missing:, 7] = 100.5
    offset = offset_of(windows)
    assert (offset is not None) == found
    if offset is not None:
        np.testing.assert_allclose(offset, np.where(np.arange(36) == 7, 100.5, 100.0))


def test_complete_windows_come_before_patched_ones() -> None:
    windows = np.full((2, 12, 36), 100.0)
    windows[1] = 90.0
    windows[1, 0, 3] = np.nan
    np.testing.assert_allclose(offset_of(windows), np.full(36, 100.0))  # type: ignore[arg-type]


def test_a_masked_taxel_has_no_offset_and_is_not_judged() -> None:
    masked = ALL.copy()
    masked[4:6] = True
    windows = 100.0 + CHECKERBOARD + np.zeros((3, 12, 36))
    windows[:, :, 4:6] = np.nan
    noise = np.where(masked, 0.0, 1.0)
    offset = estimate_offset(idle_windows(windows, noise, masked), noise, masked, PAIRS, 1e6)
    np.testing.assert_allclose(offset, np.where(masked, 0.0, 100.0 + CHECKERBOARD))  # type: ignore[arg-type]
    assert accepted(np.where(masked, 1e4, CHECKERBOARD), masked=masked)


def offsets_of(readings: Floats, cut: float = -1e9, reference: float = 1e4) -> Offsets | None:
    """By all rules together. readings: (scans, taxels), twelve scans a window, whose noise is 1."""
    windows = readings.reshape(-1, 12, 36)
    return find_offsets(
        windows, np.ones(36), ALL, near_taxels(SQUARE), PAIRS, scale=np.inf, reference=reference, cut=cut
    )


@pytest.mark.parametrize(("rows", "columns", "found"), [(3, 4, True), (2, 5, False)])
def test_a_third_of_a_pad_that_is_never_loaded_gives_its_offsets(rows: int, columns: int, found: bool) -> None:
    """A load on all but some rows of some columns grows from scan to scan and never ends."""
    unloaded = (SQUARE.row < rows) & (SQUARE.col < columns)
    bias = 100.0 + 20.0 * CHECKERBOARD
    load = np.linspace(2000.0, 4000.0, 60)[:, np.newaxis] * ~unloaded
    offsets = offsets_of(bias + load + np.random.default_rng(0).normal(0, 1, load.shape))
    assert (offsets is not None) == found
    if offsets is not None:
        np.testing.assert_array_equal(offsets.known, unloaded)
        np.testing.assert_allclose(offsets.offset[unloaded], bias[unloaded], atol=1.0)
        np.testing.assert_allclose(offsets.offset[~unloaded], 100.0, atol=21.0)  # the median of 80 and 120


@pytest.mark.parametrize(("spreads", "load", "own"), [(1.8, 2000.0, True), (2.2, 2000.0, False), (1.8, 0.0, False)])
def test_a_taxel_beside_a_load_whenever_it_is_idle_has_its_own_offset_if_that_is_likely(
    spreads: float, load: float, own: bool
) -> None:
    """An object rocks between the first two columns. A taxel of the second that is never loaded may carry its skirt."""
    spread = 20.0 * 1.4826
    bias = 100.0 + np.where(SQUARE.col == 1, spreads * spread, 20.0 * CHECKERBOARD)
    scan = np.arange(60)[:, np.newaxis]
    first = np.where(scan < 30 if load else scan > 0, 1.0, 0.0)
    rocking = 2000.0 * first * (SQUARE.col == 0) + load * (1.0 - first) * (SQUARE.col == 1)
    offsets = offsets_of(bias + rocking + np.random.default_rng(0).normal(0, 1, rocking.shape))
    assert offsets is not None
    second = SQUARE.col == 1
    assert not offsets.known[second].any()
    np.testing.assert_allclose(offsets.offset[second], 100.0 + own * spreads * spread, atol=2.0)
    np.testing.assert_allclose(offsets.std[second], (0.5 if own else 1.0) * spread, rtol=0.05)


@pytest.mark.parametrize(("idle", "found"), [(3, False), (4, True)])
def test_offsets_need_three_scans_that_are_certainly_unloaded(idle: int, found: bool) -> None:
    """Of three the probabilities to be unloaded add up to a little less."""
    load = np.where(np.arange(24) < idle, 0.0, np.linspace(2000.0, 4000.0, 24))[:, np.newaxis]
    readings = 100.0 + 20.0 * CHECKERBOARD + load + np.random.default_rng(0).normal(0, 1, (24, 36))
    assert (offsets_of(readings) is not None) == found


@pytest.mark.parametrize(("taxels", "found"), [(3, False), (4, True)])
def test_offsets_need_two_taxels_that_are_unloaded_at_any_time(taxels: int, found: bool) -> None:
    """A row of taxels whose last is loaded; the one beside it may carry the skirt of that load. With so few neighbours
    the others are offsets because they are 0 within their noise.
    """
    layout, random = grid_sensor(1, taxels).layout, np.random.default_rng(0)
    load = np.linspace(2000.0, 4000.0, 24)[:, np.newaxis] * (np.arange(taxels) == taxels - 1)
    windows = (load + random.normal(0, 0.5, load.shape)).reshape(2, 12, taxels)
    none, near = np.zeros(taxels, dtype=np.bool_), near_taxels(layout)
    offsets = find_offsets(
        windows, np.ones(taxels), none, near, layout.neighbours(0), scale=np.inf, reference=1e4, cut=-1e9
    )
    assert (offsets is not None) == found
    assert offsets is None or offsets.known.tolist() == [True, True, False, False]


@pytest.mark.parametrize(("reference", "found"), [(1150.0, False), (1250.0, True)])
def test_offsets_of_taxels_unloaded_at_any_time_are_below_a_tenth_of_the_reference(
    reference: float, found: bool
) -> None:
    """The offsets are 80 and 120."""
    load = np.linspace(2000.0, 4000.0, 60)[:, np.newaxis] * ~((SQUARE.row < 3) & (SQUARE.col < 4))
    readings = 100.0 + 20.0 * CHECKERBOARD + load + np.random.default_rng(0).normal(0, 1, load.shape)
    assert (offsets_of(readings, reference=reference) is not None) == found


def test_levels_that_are_equal_to_the_digit_still_have_their_noise() -> None:
    """One of twelve offsets is higher by less than the levels' own noise: it is no load."""
    unloaded = (SQUARE.row < 3) & (SQUARE.col < 4)
    bias = np.where(np.arange(36) == CORNER, 100.3, 100.0)
    offsets = offsets_of(bias + np.linspace(2000.0, 4000.0, 60)[:, np.newaxis] * ~unloaded)
    assert offsets is not None
    np.testing.assert_array_equal(offsets.known, unloaded)
    np.testing.assert_allclose(offsets.offset[unloaded], bias[unloaded], atol=0.01)


def rocking(bias: Floats) -> Floats:
    """(60 scans, taxels): an object that rocks between the first two columns, over noise of 1."""
    first = np.where(np.arange(60) < 30, 1.0, 0.0)[:, np.newaxis]
    load = 2000.0 * (first * (SQUARE.col == 0) + (1.0 - first) * (SQUARE.col == 1))
    return bias + load + np.random.default_rng(0).normal(0, 1, load.shape)


@pytest.mark.parametrize(("spread", "std"), [(3.0, 0.5 * 3.0 * 1.4826), (1.0, 1.0), (0.0, 0.14)])
def test_an_offset_beside_a_load_is_known_to_half_the_spread_not_below_its_noise_nor_beyond_the_spread(
    spread: float, std: float
) -> None:
    second = SQUARE.col == 1
    offsets = offsets_of(rocking(100.0 + np.where(second, 0.0, spread * CHECKERBOARD)))
    assert offsets is not None
    np.testing.assert_allclose(offsets.offset[second], 100.0, atol=0.5)
    np.testing.assert_allclose(offsets.std[second], std, rtol=0.1)


def test_no_offset_is_below_what_the_sensor_reads() -> None:
    """Levels below 0, of which only what noise adds is read: alone, and beside a load."""
    second = SQUARE.col == 1
    alone = np.maximum(np.random.default_rng(1).normal(-1, 1, (24, 36)), 0.0)
    beside = np.maximum(rocking(np.where(second, -1.0, 2.0 + 1.5 * CHECKERBOARD)), 0.0)
    for readings, low in ((alone, ~ALL), (beside, second)):
        offsets = offsets_of(readings, cut=0.0)
        assert offsets is not None
        np.testing.assert_array_equal(offsets.offset[low], 0.0)


def test_what_a_skin_reads_after_a_load_is_not_the_offset_of_an_idle_pad_that_clips() -> None:
    """The skin relaxes: after the load that one half bears by turns, it reads less than before, here by 8 deviations.
    Offsets, of which half are clipped, are those of the idle scans before.
    """
    random, scan = np.random.default_rng(3), np.arange(120)[:, np.newaxis]
    bias = np.where(CHECKERBOARD > 0, 9.0, 0.0)
    left = (SQUARE.col < 3) == ((scan // 24) % 2 == 1)
    change = np.where(left, 2000.0, np.where(scan < 48, 0.0, -8.0)) * (scan >= 24)
    offsets = offsets_of(np.maximum(bias + change + random.normal(0, 1, change.shape), 0.0), cut=0.0)
    assert offsets is not None
    assert offsets.known.all()
    np.testing.assert_allclose(offsets.offset, bias, atol=1.0)


def test_a_masked_taxel_of_a_pad_that_is_never_idle_has_neither_offset_nor_deviation() -> None:
    masked = np.isin(np.arange(36), [3, 20])
    bias = np.random.default_rng(2).normal(100, 20, 36)
    windows = np.where(masked, np.nan, rocking(bias)).reshape(-1, 12, 36)
    offsets = find_offsets(
        windows, np.ones(36), masked, near_taxels(SQUARE), PAIRS, scale=np.inf, reference=1e4, cut=-1e9
    )
    assert offsets is not None
    far = (SQUARE.col > 2) & ~masked
    np.testing.assert_allclose(offsets.offset[far], bias[far], atol=1.0)
    assert (offsets.offset[masked] == 0.0).all()
    assert (offsets.std[masked] == 0.0).all()


def test_a_window_of_one_scan_may_be_idle() -> None:
    assert offset_of(np.full((3, 1, 36), 100.0)) is not None


def test_a_pad_that_is_still_in_one_of_its_lowest_windows_was_idle() -> None:
    windows = np.tile(100.0 * CHECKERBOARD, (2, 12, 1))
    windows[1, 6:, 7] += 10.0  # the sum stays, both taxels change
    windows[1, 6:, 8] -= 10.0
    assert offset_of(windows) is not None


def test_the_mean_of_an_idle_window_counts_where_a_sample_of_the_scans_finds_no_unloaded_ones() -> None:
    """Every other window is looked at, of which none is idle; three taxels always read 0, as if clipped."""
    bias, silent = 100.0 + 20.0 * CHECKERBOARD, np.isin(np.arange(36), [0, 17, 30])
    readings = bias + np.linspace(2000.0, 9000.0, 66 * 12)[:, np.newaxis]
    readings[12:24] = bias + np.random.default_rng(0).normal(0, 1, (12, 36))
    offsets = offsets_of(np.where(silent, 0.0, readings), cut=0.0)
    assert offsets is not None
    np.testing.assert_allclose(offsets.offset, np.where(silent, 0.0, bias), atol=1.5)


@pytest.mark.parametrize(("level", "share", "is_mean"), [(2.1, 0.018, True), (1.95, 0.026, False)])
def test_readings_of_which_more_than_2_percent_are_clipped_have_another_offset_than_their_mean(
    level: float, share: float, is_mean: bool
) -> None:
    readings = np.maximum(level + np.random.default_rng(1).normal(0, 1, (640 * 12, 36)), 0.0)
    assert (readings == 0.0).mean() == pytest.approx(share, abs=5e-4)
    offsets = offsets_of(readings, cut=0.0, reference=100.0)
    assert offsets is not None
    assert np.allclose(offsets.offset, readings.mean(axis=0), rtol=1e-9) == is_mean
    scans = 1.0 / offsets.std**2  # that were used: the likelihood needs the time of 64 windows at most
    assert 12 * 45 < scans.mean() < 12 * 64 if not is_mean else (scans == pytest.approx(12.0))


# Whole recordings

PADS = grid_sensor(4, 7, pads=2)
OF = [PADS.layout.of_pad(pad) for pad in range(2)]
STREAM = grid_sensor(4, 7, pads=2, full_scale=140e3)
TAXELS = PADS.layout.taxels
SCANS = 600


def noise(scans: int = SCANS, sigma: float = 20.0, seed: int = 0) -> Floats:
    drawn: Floats = np.random.default_rng(seed).normal(0, sigma, (scans, TAXELS))
    return drawn


def offset(mean: float, spread: float) -> Floats:
    """An idle reading per taxel, without spatial order, as electronics make it."""
    drawn: Floats = mean + np.random.default_rng(7).uniform(-spread, spread, TAXELS)
    return drawn


def grasps(pad: int, *, least: float = 0.0, most: float = 50e3, radius_m: float = 0.012) -> Floats:
    """(scans, taxels) of a load that comes and goes while it moves."""
    load = np.clip(np.sin(np.arange(SCANS) / 20), 0, 1)
    place = 0.01 * np.sin(np.arange(SCANS) / 31)
    scans = [
        dome(PADS, x, pad=pad, peak=least + (most - least) * share, radius_m=radius_m)
        for share, x in zip(load, place, strict=True)
    ]
    return np.array(scans)


def untouched(values: Floats, pad: int, mode: str = "batch") -> bool:
    """The pad's readings pass through, but for what is a few standard deviations of noise, or 2 % of the load."""
    scans, _ = conditioned(values, STREAM if mode == "stream" else PADS, mode=mode)
    taken = values[:, OF[pad]] - scans.pressure[:, OF[pad]]
    return bool(np.abs(taken).max() < max(3 * 20.0, 0.02 * values[:, OF[pad]].max()))


@pytest.mark.parametrize("spread", [0.0, 300.0, 1500.0])
def test_idle_scans_take_an_offset_away_in_a_batch(spread: float) -> None:
    bias = offset(2000, spread)
    load = grasps(0)
    scans, session = conditioned(load + bias + noise(), PADS)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    np.testing.assert_allclose(session.baseline.offset, bias, atol=20)
    np.testing.assert_allclose(scans.pressure, load, atol=20 * 6)
    touched = load[:, OF[0]].max(axis=1) > 2000
    assert scans.contact[touched, 0].all()
    assert not scans.contact[load[:, OF[0]].max(axis=1) == 0, 0].any()


@pytest.mark.parametrize("spread", [0.0, 300.0, 1500.0])
def test_an_idle_start_takes_an_offset_away_in_a_stream(spread: float) -> None:
    bias = offset(2000, spread)
    values = bias + noise()
    values[30:] += grasps(0)[:-30]
    scans, session = conditioned(values, STREAM, mode="stream")
    assert session.baseline is not None
    assert session.baseline.tared.all()
    np.testing.assert_allclose(session.baseline.offset, bias, atol=20 * 6 / 12**0.5)
    assert not scans.contact[:30].any()


def test_a_negative_offset_is_taken_away_too() -> None:
    _, session = conditioned(grasps(0) - 2000 + noise(), PADS)
    assert session.baseline is not None
    np.testing.assert_allclose(session.baseline.offset, -2000, atol=20)


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("radius_m", mostly_long([0.006, 0.012, 0.02, 0.04], 0.012))
def test_a_contact_from_the_first_to_the_last_scan_stays(mode: str, radius_m: float) -> None:
    values = dome(PADS, radius_m=radius_m) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_steady_contact_stays_while_another_pad_moves(mode: str) -> None:
    values = dome(PADS, peak=30e3) + grasps(1) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("radius_m", mostly_long([0.006, 0.012, 0.02], 0.012))
@pytest.mark.parametrize("peak", mostly_long([1e3, 2e3, 4e3], 1e3, 4e3))
def test_a_light_steady_contact_stays_beside_a_strong_one(mode: str, peak: float, radius_m: float) -> None:
    values = dome(PADS, peak=peak, radius_m=radius_m) + grasps(1) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_light_steady_contact_at_a_corner_stays(mode: str) -> None:
    values = dome(PADS, -0.03, 0.015, peak=3e3) + grasps(1) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("radius_m", mostly_long([0.006, 0.012, 0.02], 0.012))
@pytest.mark.parametrize("least", mostly_long([1e3, 2e3, 10e3], 1e3, 10e3))
def test_a_contact_whose_load_varies_but_never_lets_go_stays(mode: str, least: float, radius_m: float) -> None:
    assert untouched(grasps(0, least=least, radius_m=radius_m) + noise(), 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_an_object_that_slides_from_first_to_last_scan_stays(mode: str) -> None:
    values = np.array([dome(PADS, x) for x in np.linspace(-0.03, 0.03, SCANS)]) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_pads_are_tared_independently(mode: str) -> None:
    bias = offset(1500, 300)
    values = dome(PADS, peak=30e3) + bias + noise()
    values[30:] += grasps(1)[:-30]
    sensor = STREAM if mode == "stream" else PADS
    _, session = conditioned(values, sensor, mode=mode)
    assert session.baseline is not None
    assert session.baseline.tared.tolist() == [False, True]
    np.testing.assert_array_equal(session.baseline.offset[OF[0]], 0)
    np.testing.assert_allclose(session.baseline.offset[OF[1]], bias[OF[1]], atol=50)


def test_a_stream_without_a_full_scale_takes_nothing_away_that_might_be_a_load() -> None:
    scans, _ = conditioned(dome(PADS, peak=3e3) + noise(), PADS, mode="stream")
    assert scans.contact[:, 0].all()


def test_a_stream_that_starts_under_three_feet_takes_nothing_of_their_rims_away() -> None:
    sensor = grid_sensor(5, 7)
    feet = [(-0.008, 0.002, 14e3), (0.0, 0.0, 17e3), (-0.01, -0.005, 6e3)]
    load = sum(dome(sensor, x, y, peak=peak) for x, y, peak in feet)
    scans, session = conditioned(load + np.random.default_rng(1).normal(0, 100, (60, 35)), sensor, mode="stream")
    assert session.baseline is not None
    assert not session.baseline.tared.any()
    assert scans.contact.all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_no_tare_leaves_every_reading_as_it_is(mode: str) -> None:
    values = grasps(0) + 2000 + noise()
    scans, _ = conditioned(values, STREAM, mode=mode, tare="none")
    np.testing.assert_array_equal(scans.pressure, values)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_declared_idle_start_is_taken_away_whatever_it_reads(mode: str) -> None:
    values = dome(PADS, peak=20e3) + noise()
    values[12:] += grasps(1)[12:]
    scans, session = conditioned(values, STREAM, mode=mode, tare="start")
    assert session.baseline is not None
    assert session.baseline.tared.all()
    np.testing.assert_allclose(session.baseline.offset, values[:12].mean(axis=0), rtol=1e-12)
    assert not scans.contact[:, 0].any()


def test_a_declared_idle_start_is_the_start_of_a_long_recording_too() -> None:
    sensor = grid_sensor(1, 2)
    values = np.random.default_rng(0).normal(5000, 10, (40_000, 2))
    values[:12] -= 4000
    _, session = conditioned(values, sensor, tare="start")
    assert session.baseline is not None
    np.testing.assert_allclose(session.baseline.offset, values[:12].mean(axis=0), rtol=1e-12)


def test_a_missing_reading_in_the_idle_start_is_left_out_of_its_mean() -> None:
    values = offset(500, 100) + noise(100)
    values[3, 5] = np.nan
    _, session = conditioned(values, PADS, tare="start")
    assert session.baseline is not None
    np.testing.assert_allclose(session.baseline.offset[5], np.nanmean(values[:12, 5]))
    assert np.isfinite(session.baseline.offset).all()


def test_a_short_recording_declared_idle_gives_its_plain_mean() -> None:
    values = offset(500, 100) + noise(5)
    _, session = conditioned(values, PADS, tare="start")
    assert session.baseline is not None
    np.testing.assert_allclose(session.baseline.offset, values.mean(axis=0))


@pytest.mark.parametrize("missing", [np.nan, np.inf])
def test_a_dead_taxel_does_not_keep_a_pad_from_being_tared(missing: float) -> None:
    values = grasps(0) + 1000 + noise()
    values[:, 3] = missing
    _, session = conditioned(values, PADS)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert session.baseline.masked.tolist() == [taxel == 3 for taxel in range(TAXELS)]


def test_a_taxel_that_fails_now_and_then_does_not_keep_a_pad_from_being_tared() -> None:
    values = grasps(0) + 1000 + noise()
    values[np.random.default_rng(3).random(SCANS) < 0.2, 3] = np.nan
    _, session = conditioned(values, PADS)
    assert session.baseline is not None
    assert session.baseline.tared.all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_an_idle_recording_with_an_offset_is_no_contact(mode: str) -> None:
    scans, session = conditioned(offset(3000, 500) + noise(), STREAM, mode=mode)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert not scans.contact.any()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_an_offset_small_against_full_scale_is_taken_away_even_if_loads_are_light(mode: str) -> None:
    values = offset(3000, 500) + noise()
    values[30:] += grasps(0, most=20e3)[:-30]
    scans, session = conditioned(values, STREAM, mode=mode)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert not scans.contact[:30].any()


# Without idle windows

STROKE = grid_sensor(5, 8)


def stroke(scans: int = 36, sigma: float = 100.0) -> tuple[Floats, Floats]:
    """Readings of a contact that moves all the time, and the offsets in them."""
    random = np.random.default_rng(5)
    bias = random.uniform(1000, 3000, 40)
    load = np.array([dome(STROKE, x, radius_m=0.006, peak=60e3) for x in np.linspace(-0.035, 0.035, scans)])
    return load + bias + random.normal(0, sigma, load.shape), bias


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_taxels_that_are_unloaded_at_any_time_have_the_offset_of_then(mode: str) -> None:
    values, bias = stroke()
    _, session = conditioned(values, STROKE, mode=mode)
    found = session.baseline
    assert found is not None
    assert found.tared.all()
    assert found.known.mean() > 0.5
    off = found.offset - bias
    assert np.abs(off[found.known]).max() < 300
    assert np.sqrt(np.mean(off**2)) < 500
    assert found.offset_std[found.known].max() < 100
    assert (found.offset_std[~found.known] > 100).all()
    assert np.mean(np.abs(off) < 3 * found.offset_std) > 0.9


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("idle", [3, 4, 5])
def test_a_handful_of_idle_scans_is_enough(mode: str, idle: int) -> None:
    values, bias = stroke(30)
    resting = bias + np.random.default_rng(6).normal(0, 100, (idle, 40))
    _, session = conditioned(np.concatenate([resting, values]), STROKE, mode=mode)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert np.sqrt(np.mean((session.baseline.offset - bias) ** 2)) < 250


def test_a_stream_that_starts_loaded_learns_offsets_once_it_is_released() -> None:
    values = offset(2000, 800) + noise()
    values[:30] += dome(PADS, radius_m=0.02) + dome(PADS, radius_m=0.02, pad=1)
    scans, session = conditioned(values, PADS, mode="stream")
    assert session.baseline is not None
    assert session.baseline.tared.all()
    np.testing.assert_allclose(session.baseline.offset, offset(2000, 800), atol=100)
    assert not scans.contact[-100:].any()


@pytest.mark.parametrize("full_scale", [None, 255.0])
def test_a_stream_that_reads_down_to_0_has_its_idle_level_with_or_without_a_full_scale(
    full_scale: float | None,
) -> None:
    random = np.random.default_rng(0)
    bias = random.uniform(0.7, 3, TAXELS)
    values = np.round(np.maximum(bias + random.normal(0, 0.4, (SCANS, TAXELS)), 0.0))
    sensor = grid_sensor(4, 7, pads=2, unit="count", full_scale=full_scale)
    scans, session = conditioned(values, sensor, mode="stream")
    assert session.baseline is not None
    assert np.sqrt(np.mean((session.baseline.offset - values.mean(axis=0)) ** 2)) < 0.25
    assert not scans.contact.any()


def test_the_mean_of_clipped_readings_is_no_offset() -> None:
    _, session = conditioned(np.maximum(noise(sigma=100.0), 0.0), PADS)
    assert session.baseline is not None
    assert np.abs(session.baseline.offset).max() < 25
