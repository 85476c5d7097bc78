from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import grid_sensor, pieces, raw_scans, recorded
from taxelflow.acquire.base import Reading, Recording
from taxelflow.errors import RecordingCorrupt, RecordingTruncated, TaxelCountWrong, TimesNotIncreasing
from taxelflow.messages import RawScans, joined

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.sensors.sensor import Sensor

ONE = grid_sensor(1, 1)


def read_until_error(reading: Reading) -> tuple[list[float], Exception | None]:
    seen: list[float] = []
    try:
        for block in reading:
            seen += block.t_s.tolist()
    except (TimesNotIncreasing, TaxelCountWrong, RecordingCorrupt) as error:
        return seen, error
    return seen, None


def stamped(t_s: list[float], block: int = 1024) -> Recording:
    return recorded(np.arange(len(t_s))[:, np.newaxis], ONE, t_s, block=block)


def test_blocks_start_again_at_each_call() -> None:
    recording = recorded(np.arange(10.0)[:, np.newaxis], ONE, block=3)
    first, second = (joined(list(recording.blocks())) for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    assert [len(block) for block in recording.blocks()] == [3, 3, 3, 1]


def test_load_gives_the_whole_recording() -> None:
    whole = recorded(np.arange(10.0)[:, np.newaxis], ONE, block=4).load()
    np.testing.assert_array_equal(whole.values[:, 0], np.arange(10.0))


@pytest.mark.parametrize("block", [1, 2, 3, 100])
def test_repeated_stamps_are_dropped_and_counted_and_the_first_of_them_stays(block: int) -> None:
    recording = stamped([0.0, 0.1, 0.1, 0.1, 0.2, 0.2], block)
    reading = recording.blocks()
    whole = joined(list(reading))
    np.testing.assert_array_equal(whole.t_s, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(whole.values[:, 0], [0, 1, 4])
    assert (reading.scans, reading.repeated) == (3, 3)


@pytest.mark.parametrize("block", [1, 2, 3, 100])
def test_a_time_that_runs_backwards_is_an_error_after_what_came_before_it(block: int) -> None:
    seen, error = read_until_error(stamped([0.0, 0.1, 0.2, 0.15, 0.3], block).blocks())
    assert seen == [0.0, 0.1, 0.2]
    assert isinstance(error, TimesNotIncreasing)
    assert "scan 3 is at 0.150000 s after 0.200000 s" in str(error)


@pytest.mark.parametrize("block", [1, 2, 100])
def test_the_scan_number_in_the_error_counts_dropped_scans(block: int) -> None:
    _, error = read_until_error(stamped([0.0, 0.0, 0.1, 0.05], block).blocks())
    assert "scan 3 " in str(error)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [0, 2, 4])
def test_a_time_that_is_no_finite_number_is_an_error(bad: float, place: int) -> None:
    t_s = [0.0, 0.1, 0.2, 0.3, 0.4]
    t_s[place] = bad
    seen, error = read_until_error(stamped(t_s, 2).blocks())
    assert isinstance(error, TimesNotIncreasing)
    assert seen == [0.0, 0.1, 0.2, 0.3, 0.4][:place]


def test_negative_and_large_times_are_fine() -> None:
    seen, error = read_until_error(stamped([-5.0, -1.0, 0.0, 1.7e9]).blocks())
    assert error is None
    assert seen == [-5.0, -1.0, 0.0, 1.7e9]


def test_a_wrong_number_of_taxels_names_both_counts_and_the_sensor() -> None:
    recording = Recording("memory", "memory", grid_sensor(2, 3), lambda: iter([raw_scans(np.zeros((4, 5)))]))
    with pytest.raises(TaxelCountWrong, match=r"5 taxels .*'grid' has 6.*--sensor"):
        recording.load()


def test_a_recording_without_scans_is_corrupt() -> None:
    with pytest.raises(RecordingCorrupt, match="not damaged, but holds no scans"):
        Recording("memory", "memory", ONE, lambda: iter([])).load()
    with pytest.raises(RecordingCorrupt, match="not damaged, but holds no scans"):
        recorded(np.zeros((0, 1)), ONE).load()


def test_dates_in_arrays_are_refused() -> None:
    for kind in ("datetime64[ns]", "timedelta64[ms]"):
        with pytest.raises(RecordingCorrupt, match=rf"t_s is {kind[:-4]}.*times in s"):
            Recording.of_arrays(np.arange(3).astype(kind), np.zeros((3, 1)), ONE)


def broken_off(scans: int) -> Recording:
    def read() -> Iterator[RawScans]:
        if scans:
            yield raw_scans(np.ones((scans, 1)))
        raise RecordingTruncated("memory", scans, 9, "cable pulled")  # type: ignore[arg-type]

    return Recording("memory", "memory", ONE, read)


def test_a_truncated_recording_ends_and_reports_the_loss() -> None:
    reading = broken_off(4).blocks()
    assert sum(len(block) for block in reading) == 4
    assert reading.loss is not None
    assert "4 of 9 scans could be read (cable pulled)" in str(reading.loss)


def test_a_recording_truncated_before_its_first_scan_is_corrupt() -> None:
    with pytest.raises(RecordingCorrupt, match="cable pulled"):
        broken_off(0).load()


def test_reading_asks_its_source_only_for_what_is_wanted() -> None:
    given_out = 0

    def endless() -> Iterator[RawScans]:
        nonlocal given_out
        for number in itertools.count():
            given_out += 1
            yield RawScans(np.array([float(number)]), np.zeros((1, 1)))

    reading = Recording("memory", "memory", ONE, endless).blocks()
    assert given_out == 0
    assert [float(block.t_s[0]) for block in itertools.islice(reading, 3)] == [0.0, 1.0, 2.0]
    assert given_out == 3


def test_a_recording_without_a_mask_has_every_taxel_on(palm: Sensor) -> None:
    recording = Recording("memory", "memory", palm, lambda: iter([]))
    assert recording.masked.shape == (28,)
    assert not recording.masked.any()


@given(
    steps=st.lists(st.sampled_from([0.0, 0.1, 0.2, -0.05, float("nan")]), max_size=12),
    cuts=st.lists(st.integers(0, 12), max_size=4),
)
def test_what_is_read_does_not_depend_on_how_the_source_cuts_it(steps: list[float], cuts: list[int]) -> None:
    t_s = np.cumsum([0.0, *steps])
    raw = raw_scans(np.arange(len(t_s))[:, np.newaxis], t_s)
    outcomes = []
    for blocks in ([raw], pieces(raw, [min(cut, len(raw)) for cut in cuts])):
        recording = Recording("memory", "memory", ONE, lambda blocks=blocks: iter(blocks))  # type: ignore[misc]
        reading = recording.blocks()
        seen, error = read_until_error(reading)
        outcomes.append((seen, str(error), reading.scans, reading.repeated))
    assert outcomes[0] == outcomes[1]


def test_a_recording_without_truth_raises_when_it_is_asked_for() -> None:
    sensor = grid_sensor(1, 2)
    with pytest.raises(RecordingCorrupt, match="holds no truth; use a recording of"):
        _ = recorded(np.zeros((3, 2)), sensor).known_truth
