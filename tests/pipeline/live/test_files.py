"""No file is written twice, nor while it is read."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from rigged import refused
from streaming import PALM, opened
from taxelflow import convert
from taxelflow.errors import AddressInvalid, SinkUnusable
from taxelflow.pipeline.live.command import opened_sinks
from taxelflow.pipeline.live.files import check_files
from taxelflow.publish.sinks.base import Ending, Head

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording

HEAD = Head(PALM, PALM.layout.pads, {"sensor": "{}"}, lambda _kind, _seen: None)


@pytest.fixture
def grasp(stroke: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording in the working directory."""
    monkeypatch.chdir(tmp_path)
    convert(stroke, tmp_path / "grasp.mcap")
    return tmp_path / "grasp.mcap"


@pytest.mark.parametrize("out", ["grasp.mcap", "./grasp.mcap", "hard.mcap", "soft.mcap"])
@pytest.mark.parametrize("command", ["run", "record"])
def test_a_run_into_the_file_that_it_reads_is_refused(
    grasp: Path, command: str, out: str, capsys: pytest.CaptureFixture[str]
) -> None:
    os.link(grasp, "hard.mcap")
    (grasp.parent / "soft.mcap").symlink_to(grasp)
    before = grasp.read_bytes()
    words = ["--to", f"mcap:{out}"] if command == "run" else [out]
    assert "the run reads this file" in refused(capsys, command, "replay:grasp.mcap?speed=max", *words)
    assert grasp.read_bytes() == before


def test_a_file_of_a_directory_that_is_read_is_refused_and_a_new_one_is_not(grasp: Path) -> None:
    (grasp.parent / "bag").mkdir()
    source = opened("replay:grasp.mcap")
    object.__setattr__(source.recording, "source", grasp.parent / "bag")
    check_files(opened_sinks(("jsonl:bag/new.jsonl",)), source)
    (grasp.parent / "bag" / "old.db3").write_text("")
    with pytest.raises(AddressInvalid, match="the run reads this file"):
        check_files(opened_sinks(("jsonl:bag/old.db3",)), source)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("jsonl:same.mcap", "mcap:./same.mcap"),
        ("tables:out", "tables:./out"),
        ("tables:out", "jsonl:out/slips.csv"),
        ("parquet:out", "parquet:out/."),
    ],
)
def test_two_sinks_on_one_file_are_refused(one: str, other: str) -> None:
    with pytest.raises(AddressInvalid, match=f"{one} writes the same file; give each sink a file of its own"):
        check_files(opened_sinks((one, other)))


def test_sinks_of_several_kinds_may_share_a_directory_and_devices() -> None:
    check_files(opened_sinks(("tables:out", "parquet:out", "jsonl:-", "jsonl:/dev/null", "mcap:/dev/null")))


def test_a_log_that_would_not_be_read_by_its_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AddressInvalid, match=r"run.bag does not end in .mcap, by which it would be read"):
        opened_sinks((f"mcap:{tmp_path}/run.bag",))
    opened_sinks((f"mcap:{tmp_path}/RUN.MCAP",))


@pytest.mark.parametrize("scheme", ["tables", "parquet", "mcap", "jsonl"])
def test_what_another_run_writes_is_refused(scheme: str, tmp_path: Path) -> None:
    if scheme == "parquet":
        pytest.importorskip("pyarrow.parquet")
    url = f"{scheme}:{tmp_path / 'out.mcap'}"
    (first,), (second,) = opened_sinks((url,)).values(), opened_sinks((url,)).values()
    first.open(HEAD)
    with pytest.raises(SinkUnusable, match="another run writes to it"):
        second.open(HEAD)
    first.close(Ending(None, ()))
    second.open(HEAD)
    second.close(Ending(None, ()))


def test_results_of_an_older_run_stay_where_a_run_is_refused(tmp_path: Path) -> None:
    (first,), (second,) = (opened_sinks((f"tables:{tmp_path}",)).values() for _ in range(2))
    first.open(HEAD)
    (tmp_path / "slips.csv").write_text("older rows")
    with pytest.raises(SinkUnusable):
        second.open(HEAD)
    assert (tmp_path / "slips.csv").read_text() == "older rows"
    first.close(Ending(None, ()))
