from __future__ import annotations

import json

import pytest

from taxelflow.cli import main
from taxelflow.errors import NameUnknown
from taxelflow.evaluation.contacts import ContactRow, ContactScore, score_contacts


@pytest.fixture(scope="module")
def scored() -> ContactScore:
    return score_contacts(1, seed=3, methods=("principal_axis",))


def row(scored: ContactScore, scenario: str, name: str, seen: str) -> ContactRow:
    (found,) = (r for r in scored.rows if (r.scenario, r.object, r.seen) == (scenario, name, seen))
    return found


@pytest.mark.parametrize("name", ["first", "second"])
def test_told_apart_an_object_is_as_good_as_alone_and_as_one_it_is_not(scored: ContactScore, name: str) -> None:
    alone, apart, one = (row(scored, "two-contacts", name, seen) for seen in ("alone", "told apart", "as one"))
    assert alone.rms_mm
    assert apart.rms_mm
    assert one.rms_mm
    assert apart.rms_mm < 1.2 * alone.rms_mm
    assert one.rms_mm > 2 * apart.rms_mm
    assert one.ok < apart.ok
    assert alone.known == 1.0


def test_every_scenario_has_its_rows_and_says_whether_it_was_noted(scored: ContactScore) -> None:
    assert scored.noted == {"two-contacts": 1.0, "two-contacts-meet": 1.0, "feet-lift": 0.0}
    assert len(scored.rows) == 2 * 6 + 1
    assert all(len(r.consistency) == 3 for r in scored.rows)


def test_an_unknown_method() -> None:
    with pytest.raises(NameUnknown, match="unknown estimator 'magic'"):
        score_contacts(1, methods=("magic",))


def test_the_command_shows_and_gives_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["score", "contacts", "--seeds", "1", "--methods", "sum"]) == 0
    said = capsys.readouterr().out
    for words in ("two-contacts, batch, 1 seeds from 0", "told apart", "as one", "100% of runs note"):
        assert words in said
    assert main(["score", "contacts", "--seeds", "1", "--methods", "lnorm", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["noted"]["feet-lift"] == 0.0
