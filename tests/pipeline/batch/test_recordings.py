from __future__ import annotations

from pathlib import Path

import pytest

from taxelflow.errors import ParameterInvalid, RecordingsAlike
from taxelflow.pipeline.batch.recordings import find_recordings


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("runs/b.npz", "runs/a.csv", "runs/notes.md", "runs/deep/c.npz", "runs/bag/metadata.yaml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path / "runs"


def names(*words: str, folders: bool = False) -> list[str]:
    return list(find_recordings(words, Path.cwd() / "out", folders=folders))


def test_recordings_are_found_by_pattern_path_and_directory(runs: Path) -> None:
    assert names("runs/*.npz") == ["b"]
    assert names("runs/**/*.npz") == ["b", "c"]
    assert names("runs/b.npz", "runs/deep/c.npz", "runs/*.npz") == ["b", "c"]
    assert names("runs") == ["a", "b", "bag"]
    assert names("runs/bag") == ["bag"]
    assert names("runs/deep", folders=True) == ["deep"]
    assert find_recordings(["runs/b.npz"], runs / "out", folders=False) == {"b": runs / "b.npz"}


def test_a_path_with_the_letters_of_a_pattern_is_a_path(runs: Path) -> None:
    (runs / "take[1].npz").touch()
    assert names("runs/take[1].npz") == ["take[1]"]


def test_results_beside_the_recordings_are_none(runs: Path) -> None:
    (runs / "b").mkdir()
    (runs / "b" / "summary.json").touch()
    (runs / "manifest.csv").touch()
    assert list(find_recordings(["runs/*"], runs, folders=False)) == ["a", "b", "bag", "deep", "notes"]
    assert list(find_recordings(["runs"], runs, folders=False)) == ["a", "b", "bag"]


def test_results_below_a_pattern_are_none(runs: Path) -> None:
    for folder in ("out/a", "out/b", "out/.parts/x"):
        (runs / folder).mkdir(parents=True)
        (runs / folder / "slips.parquet").touch()
        (runs / folder / "object.parquet").touch()
    (runs / "out" / "a" / "summary.json").touch()
    (runs / "out" / "own").mkdir()
    (runs / "out" / "own" / "grasp.parquet").touch()
    for out, words in ((runs / "out", "runs/**/*.parquet"), (runs / "out", "runs/out/own/*.parquet")):
        assert list(find_recordings([words], out, folders=False)) == ["grasp"]


@pytest.mark.usefixtures("runs")
def test_equal_names_are_refused() -> None:
    Path("other").mkdir()
    Path("other/b.csv").touch()
    with pytest.raises(RecordingsAlike, match=r"runs/b\.npz and of .*other/b\.csv would both be in .*out/b; rename"):
        names("runs/*.npz", "other/*.csv")


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize("word", ["runs/*.bag", "nothing.npz", "runs/deep/empty"])
def test_a_word_that_matches_nothing_is_refused(word: str) -> None:
    with pytest.raises(ParameterInvalid, match="match at least one recording"):
        names("runs/b.npz", word)


def test_no_word_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="name at least one path"):
        names()
