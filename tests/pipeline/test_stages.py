from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

from costly import mostly_long
from linked import linked_hand
from synthetic import METHODS, assert_same, dome, grid_sensor, recorded
from taxelflow.acquire.base import Recording, Truth
from taxelflow.condition.parameters import Conditioner
from taxelflow.errors import CalibrationUnfit, NameUnknown, RunEnded, TimesNotIncreasing
from taxelflow.messages import (
    AMBIGUOUS,
    LOST,
    NO_POSE,
    OK,
    UNRESOLVED,
    Estimates,
    Event,
    Floats,
    Output,
    RawScans,
    Scans,
    cut,
    joined,
    no_scans,
)
from taxelflow.pipeline import stages
from taxelflow.pipeline.api import estimate
from taxelflow.pipeline.stages import Pipeline
from taxelflow.runtime import registry
from taxelflow.sensors.calibration import Calibration, PadCalibration, fingerprint
from taxelflow.slip.stage import SlipStage

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.sensors.layout import Layout

PALM = grid_sensor(4, 7, full_scale=140e3)
WIDE = grid_sensor(9, 21, full_scale=140e3)
WARM_UP = Pipeline.warm_up
"""That of the package: the other tests do without it."""
both_methods = pytest.mark.parametrize("method", METHODS)
both_modes = pytest.mark.parametrize("mode", ["batch", "stream"])


def pipeline(method: str = "convolution", mode: str = "batch") -> Pipeline:
    return Pipeline(registry.find("estimator", method)(), mode)  # type: ignore[arg-type]


def grasp_and_pull(velocity_m_s: float, *, noise: float = 100.0, seed: int = 0) -> Floats:
    """20 idle scans, 20 of a still dome, 40 in which it moves, 20 still, 20 idle; 10 Hz on the wide pad."""
    moved = np.clip(np.arange(80) - 20, 0, 40) * velocity_m_s / 10
    contact = [dome(WIDE, x - moved[-1] / 2) for x in moved]
    idle = np.zeros((20, WIDE.layout.taxels))
    values: Floats = np.concatenate([idle, contact, idle])
    return values + np.random.default_rng(seed).normal(0, noise, values.shape)


@both_methods
@both_modes
def test_every_scan_gives_a_row_in_its_order(method: str, mode: str, stroke: Recording) -> None:
    outputs = list(pipeline(method, mode).start(stroke))
    assert sum(len(output) for output in outputs) == 80
    np.testing.assert_array_equal(np.concatenate([output.slips.t_s for output in outputs]), stroke.load().t_s)
    for output in outputs:
        assert len(output.slips) == len(output.slipping) == len(output.motions)


@pytest.mark.parametrize("method", mostly_long(METHODS, "convolution"))
@both_modes
def test_the_size_of_the_sources_blocks_does_not_matter(method: str, mode: str) -> None:
    values = grasp_and_pull(0.02)
    one, other = (estimate(recorded(values, WIDE, block=block), method, mode=mode) for block in (1024, 7))  # type: ignore[arg-type]
    assert_same(one.slips, other.slips)
    assert_same(one.motions, other.motions)
    assert one.events == other.events
    np.testing.assert_array_equal(one.slipping, other.slipping)


@both_modes
@pytest.mark.parametrize("velocity_m_s", mostly_long([0.01, -0.025, 0.04], -0.025))
def test_a_moving_contact_has_the_velocity_it_has(mode: str, velocity_m_s: float) -> None:
    result = estimate(recorded(grasp_and_pull(velocity_m_s), WIDE), mode=mode)  # type: ignore[arg-type]
    moving = slice(45, 75)
    assert result.slips.velocity[moving, 0, 0].mean() == pytest.approx(velocity_m_s, rel=0.03)
    assert result.motions.velocity[moving, 0].mean() == pytest.approx(velocity_m_s, rel=0.03)
    assert abs(result.slips.velocity[moving, 0, 1].mean()) < 0.001
    assert result.slipping[moving].all()


@pytest.mark.long
@both_modes
def test_a_contact_that_holds_still_under_noise_never_slips(mode: str) -> None:
    random = np.random.default_rng(4)
    values = random.normal(0, 300, (2000, 28))
    values[50:] += dome(PALM)
    result = estimate(recorded(values, PALM), mode=mode)  # type: ignore[arg-type]
    assert result.summary.pads["pad0"].contact_scans == 1950
    assert not result.slipping.any()
    assert result.summary.events["slip_start"] == 0


@both_methods
@both_modes
def test_lifting_off_and_touching_elsewhere_is_no_slip(method: str, mode: str) -> None:
    random = np.random.default_rng(4)
    places = [None] * 20 + [-0.02] * 15 + [None] * 3 + [0.02] * 15 + [None] * 10
    values = np.array([np.zeros(28) if x is None else dome(PALM, x, 0.005, radius_m=0.006) for x in places])
    result = estimate(recorded(values + random.normal(0, 50, values.shape), PALM), method, mode=mode)  # type: ignore[arg-type]
    assert not result.slipping.any()
    assert np.nanmax(np.abs(result.slips.displacement[..., :2])) < 0.001
    assert [event.event for event in result.events] == ["contact", "release"] * 2


@both_methods
@both_modes
def test_a_missing_taxel_under_load_interrupts_only_its_own_pad(method: str, mode: str) -> None:
    two = grid_sensor(4, 7, pads=2, full_scale=140e3)
    random = np.random.default_rng(4)
    values = np.array([dome(two) + dome(two, pad=1)] * 60) + random.normal(0, 50, (60, 56))
    values[30:33, int(np.argmax(dome(two)))] = np.nan
    result = estimate(recorded(values, two), method, mode=mode)  # type: ignore[arg-type]
    assert not result.slips.valid[30:33, 0].any()
    assert result.slips.valid[5:, 1].all()
    assert not result.slipping.any()
    assert result.summary.events["release"] == 0


@both_methods
@both_modes
@pytest.mark.parametrize("scans", [1, 2, 3, 11, 12, 13])
def test_recordings_of_any_length_give_a_row_per_scan(method: str, mode: str, scans: int) -> None:
    values = dome(PALM) + np.random.default_rng(0).normal(0, 100, (scans, 28))
    result = estimate(recorded(values, PALM), method, mode=mode)  # type: ignore[arg-type]
    assert len(result.slips) == len(result.motions) == len(result.slipping) == scans
    assert result.slips.contact.all()


@both_modes
def test_no_contact_gives_rows_without_motion(mode: str) -> None:
    values = np.random.default_rng(0).normal(0, 100, (100, 28))
    result = estimate(recorded(values, PALM), mode=mode)  # type: ignore[arg-type]
    assert len(result.slips) == 100
    assert not result.slips.contact.any()
    assert not result.slips.valid.any()
    assert result.events == []


def endless() -> Iterator[RawScans]:
    for scan in itertools.count():
        yield RawScans(np.array([scan / 10]), dome(PALM)[np.newaxis] * (scan > 20))


def test_a_stream_may_be_endless() -> None:
    run = pipeline(mode="stream").start(Recording("device", "device", PALM, endless))
    outputs = list(itertools.islice(run, 30))
    assert len(outputs[0]) == 12
    assert [len(output) for output in outputs[1:]] == [1] * 29


def test_a_stream_takes_the_scans_of_a_block_one_by_one(stroke: Recording) -> None:
    assert [len(output) for output in pipeline(mode="stream").start(stroke)] == [12, *[1] * 68]


def test_a_calibrations_gains_scale_the_positions(stroke: Recording) -> None:
    exact = replace(stroke, sensor=msgspec.structs.replace(stroke.sensor, unseen_error=0.0))  # no pose beside a rest
    none = (0.0, 0.0, 0.0)
    pad = PadCalibration("pad0", 2.0, 1.0, 10.0, 10.0, none, none, 0.0, 0.0, 60, 60, 0.1)
    calibration = Calibration("lnorm", "grid", fingerprint(exact.sensor), "0", (pad,))
    plain, scaled = (estimate(exact, "lnorm", calibration=one).slips.pose[:, 0] for one in (None, calibration))
    np.testing.assert_allclose(scaled[:, 0], 2.0 * plain[:, 0])
    np.testing.assert_allclose(scaled[:, 1], plain[:, 1])


def test_a_stream_does_not_read_ahead_of_what_it_gives() -> None:
    read = 0

    def counted() -> Iterator[RawScans]:
        nonlocal read
        for block in endless():
            read += 1
            yield block

    run = pipeline(mode="stream").start(Recording("device", "device", PALM, counted))
    assert read == 0
    given: list[Output] = list(itertools.islice(run, 5))
    assert read == sum(len(output) for output in given) == 16


@both_modes
def test_what_came_before_a_time_that_runs_backwards_is_estimated(mode: str) -> None:
    t_s = np.arange(60) / 10
    t_s[45] = 1.0
    values = dome(PALM) + np.random.default_rng(0).normal(0, 100, (60, 28))
    rows = 0
    with pytest.raises(TimesNotIncreasing, match="scan 45"):
        for output in pipeline(mode=mode).start(recorded(values, PALM, t_s)):
            rows += len(output)
    assert rows == 45


@both_modes
def test_an_interrupt_gives_what_came_before_it(mode: str) -> None:
    raw = recorded(dome(PALM) + np.random.default_rng(0).normal(0, 100, (60, 28)), PALM).load()
    times = itertools.count()

    def interrupted() -> Iterator[RawScans]:
        yield cut(raw, 0, 45)
        if mode == "stream" or next(times):  # a batch reads twice
            raise KeyboardInterrupt
        yield cut(raw, 45, 60)

    rows = 0
    with pytest.raises(KeyboardInterrupt):
        for output in pipeline(mode=mode).start(Recording("device", "device", PALM, interrupted)):
            rows += len(output)
    assert rows == 45


def test_a_run_that_has_ended_takes_no_scan(stroke: Recording) -> None:
    run = pipeline(mode="stream").start(stroke)
    run.step(stroke.load())
    run.finish()
    for more in (run.finish, lambda: run.step(stroke.load())):
        with pytest.raises(RunEnded):
            more()


def test_a_calibration_is_of_the_method_that_it_was_made_with(stroke: Recording) -> None:
    none = (0.0, 0.0, 0.0)
    pad = PadCalibration("pad0", 2.0, 1.0, 10.0, 10.0, none, none, 0.0, 0.0, 60, 60, 0.1)
    calibration = Calibration("lnorm", "grid", fingerprint(stroke.sensor), "0", (pad,))
    with pytest.raises(CalibrationUnfit, match="Convolution"):
        replace(pipeline("convolution"), calibration=calibration).start(stroke)


def test_an_unknown_mode_comes_with_the_list() -> None:
    with pytest.raises(NameUnknown, match="unknown mode 'live'; known are batch, stream"):
        pipeline(mode="live")


@both_modes
def test_a_replay_is_bit_equal(mode: str, stroke: Recording) -> None:
    one, other = (estimate(stroke, mode=mode) for _ in range(2))  # type: ignore[arg-type]
    assert_same(one.slips, other.slips)
    assert_same(one.motions, other.motions)
    assert one.summary == other.summary


def test_slips_of_a_recording_are_dated_with_hindsight_and_every_scan_is_given_once() -> None:
    recording = recorded(grasp_and_pull(5e-3), WIDE, np.arange(100) / 10)
    live, back = (list(pipeline(mode=mode).start(recording)) for mode in ("stream", "batch"))
    for outputs in (live, back):
        assert sum(len(output) for output in outputs) == 100
        for output in outputs:
            assert len(output.contacts) == len(output.motions) == len(output.slipping) == len(output)
            np.testing.assert_array_equal(output.contacts.t_s, output.slips.t_s)
    slipping = np.concatenate([output.slipping[:, 0] for output in back])
    found = slipping.nonzero()[0]  # it moves from scan 40, to the instant of scan 80
    assert set(range(41, 80)) <= set(found.tolist()) <= set(range(39, 82))
    first = next(event for output in live for event in output.events if event.event == "slip_start")
    assert first.t_s > 4.05


def pushed(recording: Recording, method: str, mode: str, size: int) -> Output:
    """All results of a recording whose scans are pushed into a run, `size` at a time."""
    run = pipeline(method, mode).start(recording)
    raw = recording.load()
    outputs = [run.step(cut(raw, start, start + size)) for start in range(0, len(raw), size)]
    return joined([*outputs, run.finish()])


@both_methods
@both_modes
@pytest.mark.parametrize("size", mostly_long([1, 7, 200], 7))
def test_scans_that_are_pushed_give_what_reading_gives(method: str, mode: str, size: int, stroke: Recording) -> None:
    read, pushes = joined(list(pipeline(method, mode).start(stroke))), pushed(stroke, method, mode, size)
    for stage in ("slips", "motions", "contacts"):
        assert_same(getattr(read, stage), getattr(pushes, stage))
    np.testing.assert_array_equal(read.slipping, pushes.slipping)
    assert read.events == pushes.events


def test_a_batch_has_learned_tare_and_noise_before_its_first_scan_and_a_stream_has_not(stroke: Recording) -> None:
    batch, stream = (pipeline(mode=mode).start(stroke).learned for mode in ("batch", "stream"))
    assert stream is None
    assert batch is not None
    assert batch.tared.all()


def test_events_that_are_complete_at_the_end_only_come_without_scans(
    stroke: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = Event(7.0, "pad0", "slip_stop")
    finish = SlipStage.finish
    monkeypatch.setattr(SlipStage, "finish", lambda held: replace(finish(held), events=[late]))
    output = list(pipeline(mode="stream").start(stroke))[-1]
    assert output.events == [late]
    assert len(output) == 0


def test_a_push_before_anything_is_learned_gives_no_rows(stroke: Recording) -> None:
    run = pipeline(mode="stream").start(stroke)
    raw = stroke.load()
    rows = [len(run.step(cut(raw, scan, scan + 1))) for scan in range(20)]
    assert rows == [0] * 11 + [12] + [1] * 8
    assert len(run.finish()) == 0


def test_a_live_run_needs_no_recording() -> None:
    run = pipeline(mode="stream").start(Recording.live(PALM))
    rows = sum(len(run.step(raw)) for raw in itertools.islice(endless(), 30))
    assert rows == 30
    assert [event.event for event in run.finish().events] == []
    assert run.learned is not None


@dataclass(frozen=True)
class Still:
    """A plug-in estimator that knows the middle of every pad, and nothing of quality, border or load."""

    quality: int = NO_POSE

    def start(self, layout: Layout, mode: str) -> Still:
        return self

    def step(self, scans: Scans) -> Estimates:
        estimates = Estimates.unknown(scans)
        estimates.pose[scans.contact] = 0.0
        estimates.quality[scans.contact] = self.quality
        return estimates

    def finish(self) -> Estimates:
        return Estimates.unknown(no_scans(PALM.layout.entries, len(PALM.layout.pads)))


def warmed_by(monkeypatch: pytest.MonkeyPatch, *pipelines: Pipeline) -> list[Pipeline]:
    """What runs on made-up recordings as pipelines warm up, one after the other, in a process of their own."""
    ran: list[Pipeline] = []
    monkeypatch.setattr(stages, "_warm", set())
    monkeypatch.setattr(stages, "Run", lambda made, _recording: ran.append(made) or [])
    for one in pipelines:
        WARM_UP(one)
    return ran


def test_a_process_is_warmed_up_once_for_what_its_streams_need(monkeypatch: pytest.MonkeyPatch) -> None:
    lnorm, convolution = pipeline("lnorm", "stream"), pipeline(mode="stream")
    ran = warmed_by(monkeypatch, lnorm, convolution, lnorm, convolution)
    assert [made.estimator for made in ran] == [lnorm.estimator, convolution.estimator]


def test_a_warm_up_leaves_out_what_fits_one_sensor_only(monkeypatch: pytest.MonkeyPatch, stroke: Recording) -> None:
    calibration = Calibration("lnorm", "grid", fingerprint(stroke.sensor), "0", ())
    calibrated = replace(pipeline("lnorm", "stream"), calibration=calibration)
    ran = warmed_by(monkeypatch, Pipeline(Still(), "stream"), calibrated)  # type: ignore[arg-type]
    assert [made.estimator for made in ran] == [pipeline().estimator, calibrated.estimator]
    assert [made.calibration for made in ran] == [None, None]


def test_joint_angles_of_the_sensor_file_place_the_pads_in_space(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    sensor = linked_hand(tmp_path)
    values = np.zeros((3, sensor.layout.taxels))
    without = pipeline().start(recorded(values, sensor))
    assert without.step(recorded(values, sensor).load()).spatial is None
    assert "there are no joint angles" in without.notes[0]
    assert isinstance(sensor.hand, msgspec.Struct)
    declared = msgspec.structs.replace(sensor, hand=msgspec.structs.replace(sensor.hand, joints="slide=0.1"))
    run = pipeline().start(recorded(values, declared))
    assert joined([run.step(recorded(values, declared).load()), run.finish()]).spatial is not None
    assert run.notes == []


def test_the_flat_rig_needs_no_joint_angles(tmp_path: Path) -> None:
    recording = recorded(np.zeros((3, 128)), linked_hand(tmp_path))
    truth = Truth("left", np.arange(3) / 10, np.zeros((3, 3)))
    assert pipeline().start(replace(recording, truth=truth)).notes == []


@both_modes
def test_a_plug_in_reports_the_contacts_borders_and_loads_of_the_scans(mode: str) -> None:
    random = np.random.default_rng(3)
    pressed = np.array([dome(PALM, x, radius_m=0.004) for x in np.linspace(0.0, 0.04, 60)])
    values = np.concatenate([np.zeros((20, 28)), pressed]) + random.normal(0, 100, (80, 28))
    recording = recorded(values, PALM)
    own, plug_in = (estimate(recording, method, mode=mode) for method in ("convolution", Still()))  # type: ignore[arg-type, list-item]
    np.testing.assert_array_equal(plug_in.slips.border, own.slips.border)
    np.testing.assert_array_equal(plug_in.slips.contact, own.slips.contact)
    np.testing.assert_array_equal(plug_in.slips.load, own.slips.load)
    share = own.summary.pads["pad0"].border_share
    assert plug_in.summary.pads["pad0"].border_share == share
    assert 0.2 < share < 0.8
    assert own.slips.load[40, 0] == pytest.approx(pressed[20].sum(), rel=0.02)
    touched, cut_off = plug_in.slips.contact[:, 0], plug_in.slips.border[:, 0].any(axis=1)
    assert (plug_in.slips.quality[touched & cut_off, 0] == AMBIGUOUS).all()
    forms = np.arange(80) == np.argmax(touched)
    assert (plug_in.slips.quality[touched & ~cut_off & ~forms, 0] == OK).all()
    assert (plug_in.slips.quality[~touched, 0] == NO_POSE).all()


@dataclass(frozen=True)
class RowByRow(Still):
    """A plug-in whose kernels are compiled for scans that lie row by row."""

    def step(self, scans: Scans) -> Estimates:
        assert scans.pressure.flags.c_contiguous
        return super().step(scans)


@both_modes
@pytest.mark.parametrize("lay", [np.asfortranarray, np.float32, lambda values: np.repeat(values, 2, axis=1)[:, ::2]])
def test_an_estimator_gets_scans_row_by_row_however_they_are_pushed(mode: str, lay: Any) -> None:
    values = np.random.default_rng(0).normal(0, 100, (40, 28)).round()
    values[20:] += dome(PALM).round()
    run = Pipeline(RowByRow(), mode).start(recorded(values, PALM))  # type: ignore[arg-type]
    pushed = RawScans(np.repeat(np.arange(40) / 10, 2)[::2], lay(values))
    outputs = [run.step(cut(pushed, 0, 20)), run.step(cut(pushed, 20, 40)), run.finish()]
    np.testing.assert_array_equal(
        joined(outputs).slips.load, estimate(recorded(values, PALM), Still(), mode=mode).slips.load
    )  # type: ignore[arg-type]


@pytest.mark.parametrize("quality", [OK, AMBIGUOUS, UNRESOLVED, LOST])
def test_what_a_method_judges_itself_is_kept(quality: int, stroke: Recording) -> None:
    slips = estimate(stroke, Still(quality)).slips  # type: ignore[arg-type]
    assert (slips.quality[slips.contact][1:] == quality).all()  # a contact forms in its first scan


def test_filters_of_the_conditioner_add_to_every_lag(stroke: Recording) -> None:
    plain = estimate(stroke, "lnorm").slips
    filtered = estimate(stroke, "lnorm", condition=Conditioner(median_scans=5)).slips
    known = np.isfinite(filtered.lag_s) & np.isfinite(plain.lag_s)
    assert known.any()
    np.testing.assert_allclose(filtered.lag_s[known] - plain.lag_s[known], 0.2)


class Late:
    """A plug-in estimator whose estimates come scan by scan, each some scans late."""

    def __init__(self, quality: int, late: int) -> None:
        self.quality, self.late = quality, late
        self.held = [Estimates.unknown(no_scans(WIDE.layout.entries, 1))]

    def step(self, scans: Scans) -> Estimates:
        estimates = Estimates.unknown(scans)
        estimates.pose[scans.contact] = 0.0
        estimates.quality[scans.contact] = self.quality
        self.held = [joined([*self.held, estimates])]
        return self.given(max(len(self.held[0]) - self.late, 0))

    def finish(self) -> Estimates:
        return self.given(len(self.held[0]))

    def given(self, count: int) -> Estimates:
        (held,) = self.held
        self.held = [cut(held, count, len(held))]
        return cut(held, 0, count)


@dataclass(frozen=True)
class Lately:
    quality: int = OK
    late: int = 10

    def start(self, layout: Layout, mode: str) -> Late:
        return Late(self.quality, self.late)


@pytest.mark.parametrize(
    ("method", "mode"),
    mostly_long(
        itertools.product(["convolution", Lately(), Lately(LOST), Lately(late=1)], ["batch", "stream"]),
        *itertools.product(["convolution", Lately(), Lately(LOST)], ["batch"]),
        (Lately(late=1), "stream"),
    ),
)
def test_contacts_that_move_apart_leave_no_scan_ok(mode: str, method: Any) -> None:
    random = np.random.default_rng(2)
    apart_m = np.concatenate([np.full(30, 0.04), np.linspace(0.04, 0.1, 40), np.full(30, 0.1)])
    values = np.array([dome(WIDE, -x / 2, radius_m=0.01) + dome(WIDE, x / 2, radius_m=0.01) for x in apart_m])
    idle = np.zeros((20, WIDE.layout.taxels))
    values = np.concatenate([idle, values]) + random.normal(0, 100, (120, WIDE.layout.taxels))
    result = estimate(recorded(values, WIDE), method, mode=mode)  # type: ignore[arg-type]
    assert len(result.slips) == 120
    assert any("moved apart" in note for note in result.summary.notes)
    ok, unresolved = (LOST, LOST) if method == Lately(LOST) else (OK, UNRESOLVED)
    assert (result.slips.quality[25:45, 0] == ok).all()
    assert (result.slips.quality[-20:, 0] == unresolved).all()


@both_modes
def test_an_estimator_gets_the_taxels_of_each_separated_contact(mode: str) -> None:
    two = dome(WIDE, -0.05, radius_m=0.01) + dome(WIDE, 0.05, radius_m=0.01)
    values = np.concatenate([np.zeros((20, WIDE.layout.taxels)), np.tile(two, (40, 1))])
    values += np.random.default_rng(2).normal(0, 100, values.shape)
    result = estimate(recorded(values, WIDE), contacts=2, mode=mode)  # type: ignore[arg-type]
    found = [np.nanmean(result.slips.pose[40:, result.pads.index(name), 0]) for name in ("pad0#1", "pad0#2")]
    np.testing.assert_allclose(np.sort(found), [-0.05, 0.05], atol=0.002)
