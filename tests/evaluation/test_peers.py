from __future__ import annotations

import importlib
import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

from rigged import refused
from taxelflow.errors import ExtraMissing, ParameterInvalid
from taxelflow.evaluation.peer_methods import peers
from taxelflow.evaluation.peers import Peers, PeersReport, accumulated
from taxelflow.evaluation.strokes import PAPER_METHODS
from taxelflow.evaluation.table1 import Table1
from taxelflow.publish.summary import to_json

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.messages import Floats

NAMES = ("phaseCorrelate", "phaseCorrelate, Hann", "DIS flow x8", "skimage correlation", "OpenPIV")
LIBRARIES = ("cv2", "skimage", "openpiv")
STROKES = 4


needs_all = pytest.mark.skipif(not all(map(find_spec, LIBRARIES)), reason="the extra bench is not installed")


def image(right: float, down: float) -> Floats:
    """A dome on 16x16 taxels, so far from the middle."""
    rows, columns = np.mgrid[:16, :16] - 7.5
    dome: Floats = 80e3 * np.exp(-((((columns - right) ** 2 + (rows - down) ** 2) / 9) ** 2))
    return dome


@needs_all
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("right", "down"), [(1.0, 0.0), (0.0, 1.0), (-2.0, 1.0)])
def test_each_peer_measures_a_dome_that_moves_right_and_down(name: str, right: float, down: float) -> None:
    seen = peers()[name](image(0, 0), image(right, down))
    assert np.hypot(seen[0] - right, seen[1] - down) < 0.35 * np.hypot(right, down)


@needs_all
@pytest.mark.parametrize("name", NAMES)
def test_each_peer_takes_the_palm_as_it_is(name: str) -> None:
    random = np.random.default_rng(0)
    palm = random.normal(0, 800, (2, 4, 7))
    palm[:, [0, 0, -1, -1], [0, -1, 0, -1]] = 0.0
    assert len(peers()[name](palm[0], palm[1])) == 2


@pytest.fixture(scope="module")
def found() -> PeersReport:
    for library in LIBRARIES:
        pytest.importorskip(library)
    return Peers(STROKES, 3, methods=PAPER_METHODS).run()


@pytest.mark.long
def test_all_methods_stand_in_one_table(found: PeersReport) -> None:
    assert [row.method for row in found.rows[::4]] == [*PAPER_METHODS, *NAMES] * 2
    assert (found.strokes, found.seed, found.ours, found.silent) == (STROKES, 3, PAPER_METHODS, [])


@pytest.mark.long
def test_our_rows_are_those_of_table_1(found: PeersReport) -> None:
    ours = [row for row in found.rows if row.method in PAPER_METHODS]
    assert ours == Table1(STROKES, 3, methods=PAPER_METHODS).run().ours


def test_the_bound_is_below_every_method(found: PeersReport) -> None:
    for bound in found.bounds:
        rows = [r for r in found.rows if (r.nominal_mm_s, r.scans) == (bound.nominal_mm_s, bound.scans)]
        assert 0.05 < bound.percent < min(row.rmse_percent for row in rows)


def test_the_best_are_the_best_and_the_ratio_is_theirs(found: PeersReport) -> None:
    assert len(found.best) == 8
    for best in found.best:
        rows = {
            r.method: r.rmse_percent
            for r in found.rows
            if (r.nominal_mm_s, r.scans, r.factor_standard_error > 0) == (best.nominal_mm_s, best.scans, best.fitted)
        }
        assert rows[best.ours] == min(rows[name] for name in PAPER_METHODS)
        assert rows[best.peer] == min(rows[name] for name in NAMES)
        assert best.ratio == pytest.approx(rows[best.peer] / rows[best.ours])


def test_json_makes_the_round_trip(found: PeersReport) -> None:
    assert msgspec.json.decode(to_json(found), type=PeersReport) == found


# Failures


def test_a_failed_pair_begins_a_new_piece_and_is_counted() -> None:
    answers: Iterator[Any] = iter([1.0, 1.0, float("nan"), 1.0, ValueError, 2.0])

    def pair(_before: Floats, _after: Floats) -> tuple[float, float]:
        answer = next(answers)
        if answer is ValueError:
            raise ValueError
        return answer, 0.0

    contact = np.array([0, 1, 1, 1, 1, 1, 1, 1, 0], dtype=np.bool_)
    x_m, piece, counts = accumulated(pair, [np.zeros((2, 2))] * 9, contact, 0.01)
    np.testing.assert_allclose(x_m[1:8], [0, 0.01, 0.02, 0, 0.01, 0, 0.02])
    assert np.isnan(x_m[[0, 8]]).all()
    assert piece[1:8].tolist() == [1, 1, 1, 2, 2, 3, 3]
    assert counts == (6, 2)


def test_a_new_contact_is_a_new_piece_and_no_failure() -> None:
    contact = np.array([1, 1, 0, 1, 1], dtype=np.bool_)
    x_m, piece, counts = accumulated(lambda *_: (1.0, 0.0), [np.zeros((2, 2))] * 5, contact, 0.01)
    np.testing.assert_allclose(x_m, [0, 0.01, np.nan, 0, 0.01])
    assert piece.tolist() == [1, 1, 1, 2, 2]
    assert counts == (2, 0)


@needs_all
def test_a_peer_that_never_answers_is_named_and_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = (float("nan"), float("nan"))
    monkeypatch.setattr("taxelflow.evaluation.peers.peers", lambda: {"mute": lambda *_: nothing})
    scored = Peers(2, 0, methods=PAPER_METHODS).run()
    assert scored.silent == ["mute"]
    assert {row.method for row in scored.rows} == set(PAPER_METHODS)
    assert [row.percent for row in scored.failed] == [100.0]
    assert scored.best == []


@needs_all
def test_a_method_of_ours_without_a_position_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match=r"methods must give a position.*'sum'"):
        Peers(2, 0, methods=("sum",)).run()


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_missing_library_is_asked_for_by_its_extra(monkeypatch: pytest.MonkeyPatch, library: str) -> None:
    real = importlib.import_module

    def absent(name: str) -> Any:
        if name.split(".", maxsplit=1)[0] == library:
            raise ImportError(name)
        return real(name) if name.split(".", maxsplit=1)[0] in sys.modules else sys

    monkeypatch.setattr("taxelflow.evaluation.peer_methods.import_module", absent)
    with pytest.raises(ExtraMissing, match=rf"{library} is not installed; .*taxelflow\[bench\]"):
        peers()


def test_it_shows_all_methods_the_bound_and_the_best(found: PeersReport, capsys: pytest.CaptureFixture[str]) -> None:
    found.show()
    shown = capsys.readouterr().out
    for word in ("L norm", "flow", "DIS", "phaseCorrelate", "OpenPIV", "skimage", "Cramér-Rao bound", "failed", ": x "):
        assert word in shown
    assert max(map(len, shown.splitlines())) <= 80


def test_its_main_table_has_a_row_for_each_speed_and_method_and_the_bound(found: PeersReport) -> None:
    rmse, best = found.tables()
    assert rmse.columns[:3] == ("speed_mm_s", "method", "all_rmse_percent")
    assert [row[:2] for row in rmse.rows] == [
        (speed, name) for speed in (25, 50) for name in (*PAPER_METHODS, *NAMES, "Cramér-Rao bound")
    ]
    assert rmse.rows[0][2:6] == tuple(row.rmse_percent for row in (found.rows[k] for k in (0, 2, 1, 3)))
    assert len(best.rows) == len(found.best)


def test_without_the_extra_the_command_names_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def absent() -> None:
        raise ExtraMissing("bench", "cv2")

    monkeypatch.setattr("taxelflow.evaluation.peers.peers", absent)
    assert "pip install 'taxelflow[bench]'" in refused(capsys, "score", "peers", "--strokes", 2)
