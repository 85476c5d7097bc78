from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from taxelflow.cli import main
from taxelflow.errors import ExtraMissing

if TYPE_CHECKING:
    from typing import Any

Capture = pytest.CaptureFixture[str]


def refused(capsys: Capture, *arguments: str) -> str:
    """The one line on stderr of a score that ends with exit code 2."""
    code = main(["score", *arguments])
    said = capsys.readouterr()
    assert (code, said.out, said.err.count("\n")) == (2, "", 1), said
    return said.err


def test_limits_shows_errors_over_the_bound_and_the_consistency(capsys: Capture) -> None:
    assert main(["score", "limits", "turn", "--seeds", "1", "--methods", "convolution", "principal_axis"]) == 0
    said = capsys.readouterr().out
    for word in ("turn, batch, 1 seeds", "x known", "x unknown", "theta deg", "NEES", "95 % band", "independent"):
        assert word in said
    assert "lnorm" not in said


def test_limits_shows_motion_since_the_first_scan_in_80_columns(capsys: Capture) -> None:
    assert main(["score", "limits", "turn", "--seeds", "2", "--methods", "principal_axis"]) == 0
    said = capsys.readouterr().out
    for word in ("motion since the first scan", "±%", "last", "unknown", "recording, s: principal_axis"):
        assert word in said
    assert max(map(len, said.splitlines())) <= 80


def test_hard_shows_every_case_and_names_strokes_that_are_far_off(capsys: Capture) -> None:
    assert main(["score", "hard", "--seeds", "1", "--seed", "3", "--methods", "convolution"]) == 0
    said = capsys.readouterr().out
    for word in ("flow, 1 recordings a case, seed 3", "2 unknown dead taxels", "saturated, dropped", "bound", "median"):
        assert word in said
    assert "flow, 25 mm/s, as in Table I: 3/" in said
    assert max(map(len, said.splitlines())) <= 80


def test_limits_names_methods_that_have_no_position(capsys: Capture) -> None:
    assert main(["score", "limits", "--seeds", "1", "--mode", "stream"]) == 0
    said = capsys.readouterr().out
    assert "stroke, stream" in said
    assert "no position, so not scored: sum" in said


def test_limits_without_a_joint_bound_shows_a_dash(capsys: Capture) -> None:
    assert main(["score", "limits", "press", "--seeds", "1", "--methods", "convolution"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("convolution  all")]
    assert rows[0][-1] == "-"


def test_limits_gives_json(capsysbinary: pytest.CaptureFixture[bytes]) -> None:
    assert main(["score", "limits", "press", "--seeds", "1", "--seed", "4", "--methods", "convolution", "--json"]) == 0
    told: dict[str, Any] = json.loads(capsysbinary.readouterr().out)
    assert (told["scenario"], told["seed"], told["mode"]) == ("press", 4, "batch")
    assert {row["over_unknown"] for row in told["rows"]} == {None}


def test_contacts_of_the_elastic_solver_may_be_scored(capsys: Capture) -> None:
    pytest.importorskip("tamaas")
    assert main(["score", "limits", "turn", "--seeds", "1", "--solver", "elastic", "--methods", "convolution"]) == 0
    assert "elastic solver" in capsys.readouterr().out
    assert main(["score", "table1", "--strokes", "2", "--solver", "elastic", "--methods", "convolution"]) == 0
    assert "elastic solver" in capsys.readouterr().out


def test_peers_shows_all_methods_the_bound_and_the_best(capsys: Capture) -> None:
    for library in ("cv2", "skimage", "openpiv"):
        pytest.importorskip(library)
    assert main(["score", "peers", "--strokes", "2", "--methods", "lnorm", "convolution"]) == 0
    said = capsys.readouterr().out
    for word in ("L norm", "flow", "DIS", "phaseCorrelate", "OpenPIV", "skimage", "Cramér-Rao bound", "failed", ": x "):
        assert word in said
    assert max(map(len, said.splitlines())) <= 80
    assert main(["score", "peers", "--strokes", "2", "--methods", "lnorm", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ours"] == ["lnorm"]


def test_peers_without_the_extra_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    def absent() -> None:
        raise ExtraMissing("bench", "cv2")

    monkeypatch.setattr("taxelflow.evaluation.peers.peers", absent)
    assert "pip install 'taxelflow[bench]'" in refused(capsys, "peers", "--strokes", "2")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["limits", "strok"], ["unknown scenario 'strok'", "stick-slip"]),
        (["limits", "bulb-pull"], ["pad must be one pad", "choose a scenario on a single pad"]),
        (["limits", "--methods", "magic"], ["unknown estimator 'magic'", "convolution"]),
        (["limits", "--seeds", "0"], ["seeds must be at least 1 (got 0)"]),
        (["limits", "--seeds", "1", "--methods", "sum"], ["must give a position", "'sum'"]),
        (["table1", "stroke"], ["of must be left out", "got 'stroke'"]),
        (["hard", "--seeds", "0"], ["seeds must be at least 1 (got 0)"]),
        (["hard", "--seeds", "1", "--methods", "sum"], ["must give a position", "'sum'"]),
        (["table1", "--strokes", "2", "--methods", "sum"], ["must give a position", "'sum'"]),
        (["table1", "--strokes", "2", "--methods", "magic"], ["unknown estimator 'magic'"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_cannot_be_scored_is_refused_in_one_line(capsys: Capture, arguments: list[str], words: list[str]) -> None:
    line = refused(capsys, *arguments)
    for word in words:
        assert word in line
