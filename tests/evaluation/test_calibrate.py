from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import pytest

import taxelflow
from synthetic import dome, grid_sensor, recorded
from taxelflow.acquire.base import Recording
from taxelflow.acquire.trajectory import Trajectory
from taxelflow.cli import main
from taxelflow.errors import GainsUnknown, NameUnknown, ParameterInvalid
from taxelflow.estimation.base import Calibratable
from taxelflow.estimation.centroid.convolution import Convolution
from taxelflow.evaluation import gainfit
from taxelflow.evaluation.calibrate import calibrate, edge_reach
from taxelflow.messages import cut, joined
from taxelflow.numerics.geometry import inverse_transform
from taxelflow.runtime import registry
from taxelflow.sensors.calibration import PadCalibration, load_calibration
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import save, simulate

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.estimation.base import EstimatorSession, Mode
    from taxelflow.messages import Floats, Scans, Slips
    from taxelflow.sensors.layout import Layout

FRAME = np.array([0.3, -0.2, 2.0])
OFFSET_S = 0.37
WIDE = grid_sensor(14, 14, full_scale=140e3)
GAIN = np.array([1.06, 0.95])
ALIKE_M = 1e-6
"""Where poses are weighed against rest, their variance counts up to a limit in pitches, which no gain scales."""


def stroke(seed: int) -> tuple[Recording, Trajectory]:
    """The paper's experiment, and its truth in another frame and on another clock."""
    recording = simulate(replace(SCENARIOS["stroke"], seed=seed))
    truth = recording.truth
    assert truth is not None
    return recording, Trajectory(truth.t_s + OFFSET_S, inverse_transform(FRAME, truth.pose[:, :2]))


def way(t_s: Floats) -> Floats:
    """A diagonal zig-zag after 3 s of rest, in the pad's frame."""
    t = np.clip(t_s - 3, 0, None)
    to_and_fro, climb = (1 - 2 * np.abs((t / period) % 2 - 1) for period in (3, 11))
    place: Floats = 0.016 * np.stack([to_and_fro + climb, to_and_fro - climb], axis=1)
    return place


def zigzag(seed: int) -> tuple[Recording, Trajectory]:
    """A soft dome that stays inside a large pad, so that gain 1 would be right; the robot says it is 1.06 and 0.95."""
    t_s = np.arange(250) / 10
    places = way(t_s)
    idle = np.arange(len(t_s)) < 15
    values = np.array([dome(WIDE, *p) * (not off) for p, off in zip(places, idle, strict=True)])
    values += np.random.default_rng(seed).normal(0, 400, values.shape)
    logged = np.arange(-2, 28, 0.05)
    return recorded(values, WIDE, t_s), Trajectory(logged + OFFSET_S, inverse_transform(FRAME, GAIN * way(logged)))


def scores(pad: PadCalibration, gain: Floats) -> list[float]:
    assert pad.std_x is not None
    frame = (np.array(pad.T_pad_robot) - FRAME) / pad.std_pad_robot
    return [
        (pad.gain_x - gain[0]) / pad.std_x,
        (pad.gain_y - gain[1]) / (pad.std_y or np.inf),
        *frame,
        (pad.time_offset_s - OFFSET_S) / pad.std_time_offset_s,
    ]


def few_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the search for the robot's frame: that it finds any angle is shown in `test_gainfit`."""
    monkeypatch.setattr(gainfit, "_SEARCH", replace(gainfit._SEARCH, starts=2))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_the_interiors_gain_of_the_papers_stroke_comes_out_within_its_standard_error(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    few_starts(monkeypatch)
    pad = calibrate(*stroke(seed), pad="palm").pads[0]
    assert pad.std_x is not None
    assert pad.std_x < 0.06
    assert abs(pad.gain_x - 1.04) < pad.std_x  # a line through all that lies within 22 mm, as in Table I
    assert abs(pad.gain_x - 1.0025) < pad.std_x  # where nothing is cut: within 10 mm, no noise
    assert np.abs(scores(pad, np.array([1.0025, 1.0]))).max() < 2
    assert (pad.gain_y, pad.std_y) == (pad.gain_x, None)
    assert pad.mm_per_index_x == pytest.approx(5 * pad.gain_x)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_without_the_edges_weight_the_gain_is_that_of_a_line_through_the_same_scans(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Noise-free and dense, a line through the centroids within 22 mm of the palm's centre has the slope 1 / 1.0456."""
    few_starts(monkeypatch)
    inner = calibrate(*stroke(seed), pad="palm", edge=0.0, within_m=0.0205).pads[0]
    assert inner.std_x is not None
    assert inner.std_x < 0.02
    assert abs(inner.gain_x - 1.0456) < 1.5 * inner.std_x
    everything = calibrate(*stroke(seed), pad="palm", edge=0.0).pads[0]
    assert everything.gain_x == pytest.approx(1.28, abs=0.06)  # Table I's factor for all scans


@pytest.mark.long
def test_on_a_diagonal_zigzag_everything_is_found_with_honest_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    few_starts(monkeypatch)
    found = [calibrate(*zigzag(seed)).pads[0] for seed in range(16)]
    assert np.mean([pad.gain_x for pad in found]) == pytest.approx(GAIN[0], abs=0.003)
    assert np.mean([pad.gain_y for pad in found]) == pytest.approx(GAIN[1], abs=0.003)
    assert np.mean([pad.time_offset_s for pad in found]) == pytest.approx(OFFSET_S, abs=0.01)
    spread = np.std([scores(pad, GAIN) for pad in found], axis=0)
    assert (spread > 0.5).all(), spread
    assert (spread < 2.0).all(), spread


@pytest.mark.long
def test_the_largest_taxel_is_calibrated_by_whole_pitches() -> None:
    recording, truth = zigzag(0)
    pad = calibrate(recording, truth, "lnorm").pads[0]
    assert pad.std_x is not None
    assert abs(pad.gain_x - GAIN[0]) < 3 * pad.std_x
    assert pad.mm_per_index_x == pytest.approx(10 * pad.gain_x)


def test_a_recordings_own_truth_serves_as_well(tmp_path: Path) -> None:
    recording = save(SCENARIOS["stroke"], tmp_path / "stroke.npz")
    found = calibrate(recording)
    assert [pad.name for pad in found.pads] == ["palm"]
    pad = found.pads[0]
    assert abs(pad.T_pad_robot[2]) < 2 * pad.std_pad_robot[2]
    assert abs(pad.time_offset_s) < 3 * pad.std_time_offset_s


@pytest.mark.long
def test_calibrated_positions_are_the_gains_times_the_plain_ones() -> None:
    recording, truth = zigzag(1)
    found = calibrate(recording, truth)
    plain, better = (taxelflow.estimate(recording, calibration=c).slips for c in (None, found))
    gain = np.array([found.pads[0].gain_x, found.pads[0].gain_y])
    np.testing.assert_allclose(better.pose[..., :2], gain * plain.pose[..., :2], atol=ALIKE_M)
    np.testing.assert_allclose(better.displacement[..., :2], gain * plain.displacement[..., :2], rtol=1e-12)
    scale = np.outer(gain, gain)
    np.testing.assert_allclose(better.covariance[..., :2, :2], scale * plain.covariance[..., :2, :2], rtol=1e-12)


def test_the_command_writes_what_estimate_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = tmp_path / "stroke.npz"
    truth = save(SCENARIOS["stroke"], recording).truth
    assert truth is not None
    log, cal, out = tmp_path / "truth.csv", tmp_path / "cal.toml", tmp_path / "out"
    table = np.column_stack([truth.t_s + OFFSET_S, inverse_transform(FRAME, truth.pose[:, :2])])
    np.savetxt(log, table, delimiter=",", header="t_s,x_m,y_m", comments="")
    arguments = ["calibrate", str(recording), "--truth", str(log), "--out", str(cal), "--pad", "palm"]
    assert main(arguments) == 0
    assert "mm per index" in capsys.readouterr().out
    assert load_calibration(cal) == calibrate(str(recording), log, pad="palm")
    assert main(["estimate", str(recording), "--out", str(out), "--calibration", str(cal)]) == 0
    assert '"gain_x": 1.0' in (out / "summary.json").read_text()
    lnorm = ["estimate", str(recording), "--out", str(out), "--calibration", str(cal), "--method", "lnorm"]
    assert main(lnorm) == 2
    assert "method 'convolution'" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cal.toml", "out", "stroke.npz", "truth.csv"]


def test_a_topic_of_no_trajectory_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, cal = tmp_path / "stroke.npz", tmp_path / "cal.toml"
    save(SCENARIOS["stroke"], recording)
    assert main(["calibrate", str(recording), "--out", str(cal), "--truth-topic", "/pose"]) == 2
    assert "--truth-topic must be left out without --truth (got '/pose')" in capsys.readouterr().err
    assert not cal.exists()


def test_a_truth_of_the_whole_hand_serves_all_pads() -> None:
    recording = simulate("turn-over-hand")
    with pytest.raises(GainsUnknown, match=r"^gains cannot be estimated: finger1_tip: the object's path spans only "):
        calibrate(recording)


@dataclass(frozen=True)
class Mine:
    """An estimator of another package: Method II, held back until the end."""

    pitches_per_index: ClassVar[float] = 0.5

    def start(self, layout: Layout, mode: Mode, calibrated: Floats | None = None) -> Held:
        return Held(Convolution().start(layout, mode, calibrated))


class Held:
    def __init__(self, session: EstimatorSession) -> None:
        self._session, self._blocks = session, []

    def step(self, scans: Scans) -> Slips:
        self._blocks.append(self._session.step(scans))
        return cut(self._blocks[0], 0, 0)

    def finish(self) -> Slips:
        return joined(self._blocks)


def test_only_methods_with_an_index_are_calibratable() -> None:
    assert isinstance(Mine(), Calibratable)
    able = [name for name in registry.names("estimator") if isinstance(taxelflow.estimator(name), Calibratable)]
    assert able == ["lnorm", "convolution"]


@pytest.mark.long
def test_a_method_of_another_package_is_calibrated_like_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry.PARTS["estimator"], "mine", f"{__name__}:{Mine.__name__}")
    found = calibrate(*zigzag(0), "mine")
    assert found.method == "mine"
    assert found.pads == calibrate(*zigzag(0)).pads
    recording, _ = zigzag(0)
    plain, scaled = (taxelflow.estimate(recording, "mine", calibration=one).slips.pose for one in (None, found))
    gain = (found.pads[0].gain_x, found.pads[0].gain_y)
    np.testing.assert_allclose(scaled[..., :2], gain * plain[..., :2], atol=ALIKE_M)


def test_what_cannot_be_calibrated_is_refused_with_the_reason(stroke: Recording) -> None:
    truth = Trajectory(np.array([0.0, 8.0]), np.zeros((2, 2)))
    with pytest.raises(GainsUnknown, match="--truth"):
        calibrate(stroke)
    with pytest.raises(GainsUnknown, match=r"^gains cannot be estimated: pad0: (?!.*cannot be estimated)"):
        calibrate(stroke, truth)
    with pytest.raises(ParameterInvalid, match=r"can be calibrated: lnorm, convolution \(got 'sum'\)"):
        calibrate(stroke, truth, "sum")
    with pytest.raises(NameUnknown, match="unknown method 'magic'"):
        calibrate(stroke, truth, "magic")
    with pytest.raises(NameUnknown, match="pad0"):
        calibrate(stroke, truth, pad="thumb")
    for wrong in ({"search_s": -1.0}, {"edge": float("nan")}, {"within_m": float("inf")}, {"within_m": 0.0}):
        with pytest.raises(ParameterInvalid):
            calibrate(stroke, truth, **wrong)  # type: ignore[arg-type]


def test_the_pad_that_was_touched_most_is_named_first() -> None:
    sensor = grid_sensor(4, 7, pads=5)
    x_m = np.linspace(-0.01, 0.01, 40)
    values = np.random.default_rng(0).normal(0, 100, (60, sensor.layout.taxels))
    values[20:] += np.array([dome(sensor, x, pad=3) for x in x_m])
    truth = Trajectory(np.arange(20, 60) / 10, 1e3 * np.stack([x_m, 0 * x_m], axis=1))  # in mm
    with pytest.raises(GainsUnknown) as caught:
        calibrate(recorded(values, sensor), truth)
    says = str(caught.value)
    assert says.startswith("gains cannot be estimated: pad3: the trajectory spans ")
    assert "; pad0: only 0 scans have a position" in says
    assert "array" not in says


def test_the_edge_reaches_no_contact_that_lies_inside_and_each_that_is_cut() -> None:
    places = np.linspace(0, 0.065, 14)
    scans = np.array([dome(WIDE, x, radius_m=0.008) for x in places])
    reach = edge_reach(WIDE.layout, 0, scans, np.full(WIDE.layout.taxels, 10.0))
    assert (reach[:6] == 0).all()
    assert (reach[:, 1] == 0).all()
    assert (np.diff(reach[:, 0]) >= 0).all()
    centroid = scans @ WIDE.layout.x_m / scans.sum(axis=1)
    cut = places > 0.05
    assert (reach[cut, 0] > np.abs(centroid - places)[cut]).all()


def test_a_quarter_turn_turns_what_the_edge_can_do() -> None:
    noise = np.ones(WIDE.layout.taxels)
    right = edge_reach(WIDE.layout, 0, dome(WIDE, 0.055, 0.01)[np.newaxis], noise)
    up = edge_reach(WIDE.layout, 0, dome(WIDE, -0.01, 0.055)[np.newaxis], noise)
    np.testing.assert_allclose(up, right[:, ::-1], rtol=1e-9)
