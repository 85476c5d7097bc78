from __future__ import annotations

import msgspec
import pytest

from rigged import rigged
from taxelflow.errors import NameUnknown
from taxelflow.evaluation import contacts
from taxelflow.evaluation.contacts import LIFT, TWO, ContactRow, Contacts, ContactsReport
from taxelflow.publish.summary import to_json


@pytest.fixture(scope="module")
def scored() -> ContactsReport:
    return Contacts(1, 3, ("principal_axis",)).run()


@pytest.fixture(scope="module")
def quick() -> ContactsReport:
    """The same at 12 scans a second."""
    with pytest.MonkeyPatch.context() as patch:
        slow = {name: rigged(name, sensing={"rate_hz": 12.0}) for name in (*TWO, LIFT)}
        patch.setattr(contacts, "SCENARIOS", slow)
        return Contacts(1, 3, ("principal_axis",)).run()


def row(scored: ContactsReport, scenario: str, name: str, seen: str) -> ContactRow:
    (found,) = (r for r in scored.rows if (r.scenario, r.object, r.seen) == (scenario, name, seen))
    return found


@pytest.mark.long
@pytest.mark.parametrize("name", ["first", "second"])
def test_a_separated_contact_is_as_accurate_as_alone_and_a_merged_one_is_not(scored: ContactsReport, name: str) -> None:
    alone, apart, one = (row(scored, "two-contacts", name, seen) for seen in ("alone", "separated", "as one"))
    assert alone.rms_mm
    assert apart.rms_mm
    assert one.rms_mm
    assert apart.rms_mm < 1.2 * alone.rms_mm
    assert one.rms_mm > 2 * apart.rms_mm
    assert one.ok < apart.ok
    assert alone.known == 1.0


def test_every_scenario_has_its_rows_and_whether_it_was_noted(quick: ContactsReport) -> None:
    assert quick.noted == {"two-contacts": 1.0, "two-contacts-meet": 1.0, "feet-lift": 0.0}
    assert len(quick.rows) == 2 * 6 + 1
    assert all(len(r.consistency) == 3 for r in quick.rows)


def test_an_unknown_method() -> None:
    with pytest.raises(NameUnknown, match="unknown method 'magic'"):
        Contacts(1, methods=("magic",)).run()


def test_it_shows_every_scenario(quick: ContactsReport, capsys: pytest.CaptureFixture[str]) -> None:
    quick.show()
    shown = capsys.readouterr().out
    for words in ("two-contacts, batch, seed 3", "separated", "as one", "100% of runs note"):
        assert words in shown


def test_its_tables_hold_the_consistency_of_each_span_and_the_notes(quick: ContactsReport) -> None:
    rows, noted = quick.tables()
    assert rows.columns[-3:] == ("nees_1", "nees_20", "nees_100")
    assert [row[-1] for row in rows.rows] == [row.consistency[-1].nees for row in quick.rows]
    assert dict(noted.rows)["feet-lift"] == 0.0


def test_json_makes_the_round_trip(quick: ContactsReport) -> None:
    assert msgspec.json.decode(to_json(quick), type=ContactsReport) == quick
