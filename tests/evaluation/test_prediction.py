from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from rigged import refused, rigged, svg_words
from synthetic import dome, grid_sensor, recorded, scans_of
from tabled import hexagonal, table_sensor
from taxelflow.cli import main
from taxelflow.evaluation.prediction import Prediction, PredictionReport, _moved, score_recordings
from taxelflow.pipeline import api
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats

SENSOR = grid_sensor(8, 8, pitch_m=(0.005, 0.005))


def slide(x_m: Floats, noise: float = 200.0) -> Recording:
    """A dome at these places, after 20 idle scans."""
    scans = [dome(SENSOR, x, radius_m=0.006) for x in x_m]
    values = np.concatenate([np.zeros((20, 64)), scans])
    return recorded(values + np.random.default_rng(0).normal(0, noise, values.shape), SENSOR)


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("real") / "turn.npz"
    save(rigged("turn", motion={"strokes": 1}), path)
    return path


@pytest.mark.long
def test_a_moving_object_is_predicted_better_than_no_motion() -> None:
    (row,) = score_recordings([slide(np.linspace(-0.008, 0.008, 60))]).predictions
    assert row.scans == 58
    assert row.registered_percent < 0.7 * row.no_motion_percent
    assert row.registered_percent < row.centroid_percent
    assert row.forecast_percent < row.no_motion_percent


@pytest.mark.long
def test_a_still_object_is_predicted_to_the_noise() -> None:
    (row,) = score_recordings([slide(np.zeros(60))]).predictions
    assert row.no_motion_percent == pytest.approx(np.sqrt(2) * row.noise_percent, rel=0.1)
    assert row.registered_percent < 1.1 * row.no_motion_percent  # a still object shows its pattern a few times only
    assert row.noise_percent == pytest.approx(
        100 * 200.0 / np.sqrt(np.mean(dome(SENSOR, radius_m=0.006) ** 2)), rel=0.1
    )
    assert row.lost == 0


@pytest.mark.long
def test_a_jump_is_charged_to_the_template() -> None:
    way = np.repeat([-0.012, 0.012], 20)
    still, jumped = (score_recordings([slide(x)]).predictions[0] for x in (np.full(40, -0.012), way))
    assert jumped.forecast_percent > 3 * still.forecast_percent


def test_taxels_in_no_grid_are_moved_where_they_lie() -> None:
    table = table_sensor(hexagonal(5, 0.003))
    before, now = (scans_of(table, [dome(table, x, radius_m=0.005)], noise=1.0) for x in (0.0, 0.001))
    moved = _moved(table.layout, 0, before, now)
    still, off = (np.abs(image - now.pressure[0]).mean() for image in (before.pressure[0], moved))
    assert off < 0.5 * still


@pytest.mark.parametrize("count", [2, 5])
def test_taxels_on_a_line_are_moved_along_it(count: int) -> None:
    table = table_sensor(0.003 * np.outer(np.arange(count), (0.6, 0.8)))
    before, now = (scans_of(table, 1e4 * np.eye(count)[[taxel]]) for taxel in (0, 1))
    assert np.allclose(_moved(table.layout, 0, before, now), 1e4 * (np.arange(count) < 2))


@pytest.fixture(scope="module")
def scored(turned: Path) -> PredictionReport:
    return Prediction((turned,)).run()


@pytest.mark.long
def test_turns_stand_beside_the_axis(scored: PredictionReport) -> None:
    (turn,) = scored.turns
    assert turn.recording == "turn.npz"
    assert abs(turn.template_deg - turn.axis_deg) < 10
    assert turn.apart_deg < 10


def test_a_contact_too_short_to_predict_is_left_out() -> None:
    assert score_recordings([slide(np.zeros(2))]) == PredictionReport([], [])


def test_it_shows_predictions_and_turns_in_80_columns(
    scored: PredictionReport, capsys: pytest.CaptureFixture[str]
) -> None:
    scored.show()
    shown = capsys.readouterr().out
    for word in ("turn.npz", "forecast", "registered", "template deg"):
        assert word in shown
    assert max(map(len, shown.splitlines())) <= 80
    assert scored.predictions[0].scans > 100


def test_its_tables_are_predictions_and_turns(scored: PredictionReport) -> None:
    scans, turn = scored.tables()
    assert (scans.columns[:3], turn.columns[:3]) == (("recording", "pad", "scans"), ("recording", "pad", "from_s"))
    assert (len(scans.rows), len(turn.rows)) == (len(scored.predictions), len(scored.turns))


def test_the_command_needs_recordings_and_options_that_fit_them(
    turned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "recordings must name at least one recording" in refused(capsys, "score", "prediction")
    assert "no meaning there" in refused(capsys, "score", "prediction", turned, "--topic", "touch")


@pytest.mark.long
def test_a_learned_pattern_is_written_and_drawn(turned: Path, tmp_path: Path) -> None:
    out = tmp_path / "result"
    assert main(["estimate", str(turned), "--out", str(out), "--method", "template"]) == 0
    assert (out / "patterns.npz").is_file()
    assert main(["plot", str(out)]) == 0
    (drawn,) = out.glob("pattern-*.svg")
    assert {"truth", "principal axis", "template"} <= set(svg_words(drawn))
    assert main(["estimate", str(turned), "--out", str(out), "--method", "convolution"]) == 0
    assert not (out / "patterns.npz").exists()


@pytest.fixture(scope="module")
def teapot(recordings: Path) -> PredictionReport:
    return score_recordings([api.read(recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa")])


@pytest.mark.long
def test_real_contacts_are_scored(teapot: PredictionReport) -> None:
    assert {row.pad for row in teapot.predictions} == {"finger2_distal", "finger1_distal"}
    assert all(row.scans > 50 and row.no_motion_percent > row.noise_percent for row in teapot.predictions)


@pytest.mark.long
def test_real_contacts_are_explained_better_than_by_the_scan_before(recordings: Path, teapot: PredictionReport) -> None:
    """Rounding, and so the processor, decides which fit the map of the teapot's handle on one finger reaches."""
    grasp = score_recordings([api.read(recordings / "sdh-dsa" / "reactive_grasping.dsa")])
    assert all(row.forecast_percent < row.no_motion_percent for row in teapot.predictions)
    assert any(row.registered_percent < row.no_motion_percent for row in teapot.predictions)
    assert grasp.predictions
    assert all(row.registered_percent < row.no_motion_percent for row in grasp.predictions)
    assert all(row.registered_percent < row.centroid_percent for row in grasp.predictions)
