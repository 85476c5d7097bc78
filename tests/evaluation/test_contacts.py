from __future__ import annotations

import msgspec
import pytest

from taxelflow.errors import NameUnknown
from taxelflow.evaluation.contacts import ContactRow, Contacts, ContactsReport
from taxelflow.publish.summary import to_json


@pytest.fixture(scope="module")
def scored() -> ContactsReport:
    return Contacts(1, 3, ("principal_axis",)).run()


def row(scored: ContactsReport, scenario: str, name: str, seen: str) -> ContactRow:
    (found,) = (r for r in scored.rows if (r.scenario, r.object, r.seen) == (scenario, name, seen))
    return found


@pytest.mark.parametrize("name", ["first", "second"])
def test_told_apart_an_object_is_as_good_as_alone_and_as_one_it_is_not(scored: ContactsReport, name: str) -> None:
    alone, apart, one = (row(scored, "two-contacts", name, seen) for seen in ("alone", "told apart", "as one"))
    assert alone.rms_mm
    assert apart.rms_mm
    assert one.rms_mm
    assert apart.rms_mm < 1.2 * alone.rms_mm
    assert one.rms_mm > 2 * apart.rms_mm
    assert one.ok < apart.ok
    assert alone.known == 1.0


def test_every_scenario_has_its_rows_and_says_whether_it_was_noted(scored: ContactsReport) -> None:
    assert scored.noted == {"two-contacts": 1.0, "two-contacts-meet": 1.0, "feet-lift": 0.0}
    assert len(scored.rows) == 2 * 6 + 1
    assert all(len(r.consistency) == 3 for r in scored.rows)


def test_an_unknown_method() -> None:
    with pytest.raises(NameUnknown, match="unknown method 'magic'"):
        Contacts(1, methods=("magic",)).run()


def test_it_shows_every_scenario(scored: ContactsReport, capsys: pytest.CaptureFixture[str]) -> None:
    scored.show()
    shown = capsys.readouterr().out
    for words in ("two-contacts, batch, 1 seeds from 3", "told apart", "as one", "100% of runs note"):
        assert words in shown


def test_its_tables_hold_the_consistency_of_each_span_and_the_notes(scored: ContactsReport) -> None:
    rows, noted = scored.tables()
    assert rows.columns[-3:] == ("nees_1", "nees_20", "nees_100")
    assert [row[-1] for row in rows.rows] == [row.consistency[-1].nees for row in scored.rows]
    assert dict(noted.rows)["feet-lift"] == 0.0


def test_json_makes_the_round_trip(scored: ContactsReport) -> None:
    assert msgspec.json.decode(to_json(scored), type=ContactsReport) == scored
