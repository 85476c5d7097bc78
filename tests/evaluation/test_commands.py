"""`taxelflow score NAME`: how a score is found, what its help shows, what is written."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import pytest

from rigged import refused
from taxelflow.cli import main
from taxelflow.evaluation.base import Table, write_tables
from taxelflow.evaluation.commands import Output
from taxelflow.runtime import registry

Capture = pytest.CaptureFixture[str]
TINY = ("score", "table1", "--strokes", "2", "--methods", "lnorm")
NAMES = [
    "table1",
    "hard",
    "field",
    "slip",
    "hand",
    "limits",
    "peers",
    "contacts",
    "prediction",
    "robustness",
    "xela",
    "live",
    "view",
    "batch",
]
PLUGIN = '''
from dataclasses import dataclass
from pathlib import Path

import msgspec

from taxelflow.evaluation.base import table_of, unwatched


class Row(msgspec.Struct):
    side_m: float
    area_m2: float


class Report(msgspec.Struct):
    rows: list[Row]

    def tables(self):
        return [table_of("rows", self.rows, Row)]

    def show(self):
        print("areas:", *(row.area_m2 for row in self.rows))


@dataclass(frozen=True)
class Squares:
    """Measure squares."""

    sides: int = 2
    """How many."""

    def run(self, watched=unwatched):
        return Report([Row(float(k), float(k * k)) for k in watched(range(1, self.sides + 1), "sides")])
'''


def ended(*arguments: str) -> object:
    try:
        return main(list(arguments))
    except SystemExit as end:
        return end.code


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A package that is not taxelflow's announces a score, as pip would install it."""
    site = tmp_path / "site"
    (site / "plug-1.0.dist-info").mkdir(parents=True)
    (site / "score_for_taxelflow.py").write_text(PLUGIN)
    (site / "plug-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: plug\nVersion: 1.0\n")
    (site / "plug-1.0.dist-info" / "entry_points.txt").write_text(
        "[taxelflow.score]\nsquares = score_for_taxelflow:Squares\n"
    )
    monkeypatch.syspath_prepend(site)
    monkeypatch.delitem(sys.modules, "score_for_taxelflow", raising=False)
    return "squares"


# Names and help


def test_the_names_of_the_scores() -> None:
    assert registry.names("score") == NAMES


def test_help_lists_every_score_with_one_line_of_its_own(capsys: Capture) -> None:
    assert ended("score", "--help") == 0
    lines = [line.strip("│ ") for line in capsys.readouterr().out.splitlines()]
    for name in NAMES:
        (line,) = (line for line in lines if line.startswith(f"• {name} "))
        assert line.removeprefix(f"• {name} ").strip() == registry.summary("score", name)


@pytest.mark.parametrize(
    ("name", "own", "others"),
    [
        ("table1", ["--strokes", "--seed", "--methods", "--solver"], ["--hours", "--topic", "--seeds", "--mode"]),
        ("field", ["--seeds", "--methods"], ["--seed ", "--solver"]),
        ("slip", ["--hours", "--alarms-per-hour", "--processes"], ["--strokes", "--solver", "--mode"]),
        ("prediction", ["--sensor", "--topic"], ["--seeds", "--methods"]),
    ],
)
def test_a_score_has_its_own_options_and_no_others(
    capsys: Capture, name: str, own: list[str], others: list[str]
) -> None:
    assert ended("score", name, "--help") == 0
    shown = capsys.readouterr().out
    assert registry.summary("score", name) in shown
    for option in (*own, "--json", "--csv"):
        assert option in shown
    for option in others:
        assert option not in shown


@pytest.mark.parametrize(("name", "meant"), [("table2", "did you mean 'table1'? "), ("real", "")])
def test_an_unknown_score_is_refused_with_the_list(capsys: Capture, name: str, meant: str) -> None:
    line = refused(capsys, "score", name)
    assert line == f"taxelflow: unknown score '{name}'; {meant}known are {', '.join(NAMES)}\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["score"],
        ["score", "--strokes", "2"],
        ["score", "table1", "--strokes", "many"],
        ["score", "table1", "--hours", "1"],
        ["score", "table1", "stroke"],
        ["score", "limits", "stroke", "turn"],
        ["score", "limits", "--topic", "touch"],
    ],
    ids=" ".join,
)
def test_what_is_not_understood_ends_with_2(capsys: Capture, arguments: list[str]) -> None:
    assert ended(*arguments) == 2
    said = capsys.readouterr()
    assert (said.out, bool(said.err)) == ("", True)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["limits", "strok"], ["unknown scenario 'strok'", "stick-slip"]),
        (["limits", "--seeds", "0"], ["seeds must be at least 1 (got 0)"]),
        (["slip", "--hours", "-1"], ["hours must be 0 or more (got -1.0)"]),
        (["table1", "--strokes", "1"], ["strokes must be at least 2 (got 1)"]),
        (["table1", "--strokes", "2", "--methods", "sum"], ["must give a position", "'sum'"]),
        (["hard", "--methods", "magic"], ["unknown method 'magic'", "convolution"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_cannot_be_scored_is_refused_in_one_line(capsys: Capture, arguments: list[str], words: list[str]) -> None:
    line = refused(capsys, "score", *arguments)
    for word in words:
        assert word in line


# What is written


@pytest.mark.long
def test_the_report_is_shown_and_its_tables_are_written(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "table1.csv"
    assert main([*TINY, "--csv", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "ours: 2 strokes a speed, seed 0" in shown
    assert shown.endswith(f"rows in {path}\nrows in {tmp_path / 'table1-paper.csv'}\n")
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:3] == ["nominal_mm_s", "method", "scans"]
    assert {"backward_mm_s", "rmse_mm_s", "rmse_percent"} < set(rows[0])
    assert (len(rows), {row["method"] for row in rows}) == (8, {"lnorm"})
    assert sorted(found.name for found in tmp_path.iterdir()) == ["table1-paper.csv", "table1.csv"]


@pytest.mark.long
def test_json_has_the_numbers_of_the_csv(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "table1.csv"
    assert main([*TINY, "--json", "--csv", str(path)]) == 0
    whole = json.loads(capsys.readouterr().out)
    with path.open(newline="", encoding="utf-8") as file:
        for printed, row in zip(whole["ours"], csv.DictReader(file), strict=True):
            assert float(row["rmse_percent"]) == pytest.approx(printed["rmse_percent"], rel=1e-5)


@pytest.mark.parametrize(("name", "word"), [("rows.txt", "end in .csv"), ("none/rows.csv", "directory that exists")])
def test_a_csv_that_cannot_be_written_is_refused_before_the_work(
    tmp_path: Path, capsys: Capture, name: str, word: str
) -> None:
    assert word in refused(capsys, "score", "slip", "--csv", tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_cells_have_six_digits_or_are_empty(tmp_path: Path) -> None:
    table = Table("rows", ("name", "rms_mm", "n"), [("a, b", 1 / 3, 12345678), ("c", None, 0), ("d", float("nan"), 1)])
    assert write_tables([table], tmp_path / "rows.csv") == [tmp_path / "rows.csv"]
    assert (tmp_path / "rows.csv").read_text() == 'name,rms_mm,n\n"a, b",0.333333,12345678\nc,,0\nd,,1\n'


def test_files_are_named_by_what_they_hold(tmp_path: Path, capsys: Capture) -> None:
    rows = tmp_path / "rows.csv"
    tables = [Table("rows", ("n",), [(1,)])]
    drawn = (Path("picture.svg"), Path("x.png"))
    assert Output(csv=rows).give(None, lambda: print("shown"), tables=lambda: tables, drawn=drawn) == 0
    assert capsys.readouterr().out == f"shown\nrows in {rows}\ndrawn in picture.svg\ndrawn in x.png\n"


# Scores of other packages


def test_a_score_of_another_package_is_listed_run_and_written(plugin: str, tmp_path: Path, capsys: Capture) -> None:
    assert ended("score", "--help") == 0
    assert "squares     Measure squares." in capsys.readouterr().out
    assert "score_for_taxelflow" not in sys.modules
    path = tmp_path / "squares.csv"
    assert main(["score", plugin, "--sides", "3", "--csv", str(path)]) == 0
    assert capsys.readouterr().out == f"areas: 1.0 4.0 9.0\nrows in {path}\n"
    assert path.read_text() == "side_m,area_m2\n1,1\n2,4\n3,9\n"
    assert main(["score", plugin, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"][1] == {"side_m": 2.0, "area_m2": 4.0}


@pytest.mark.parametrize("name", [*NAMES])
def test_every_score_is_frozen_and_documents_its_options(name: str) -> None:
    kind = registry.find("score", name)
    assert kind.__dataclass_params__.frozen
    assert kind.__doc__.splitlines()[0] == registry.summary("score", name)
