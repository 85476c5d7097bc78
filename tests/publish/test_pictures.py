"""Pictures of an earlier result, which a new one replaces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rigged import estimated, rigged
from taxelflow.publish.pictures import pictures_of
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from pathlib import Path

OURS = ("position-palm.svg", "pattern-palm-2.png", "path-convolution.pdf", "patterns-template.svg", "views.png")
OTHERS = ("position-thumb.svg", "path-mine.svg", "positions.svg", "path-lnorm.csv", "slip.gif", "notes.txt")


def test_a_result_that_is_estimated_again_loses_its_pictures_and_nothing_else(tmp_path: Path) -> None:
    save(rigged(), tmp_path / "stroke.npz")
    result = estimated(tmp_path / "stroke.npz", tmp_path / "result")
    tables = {path.name for path in result.iterdir()}
    for name in (*OURS, *OTHERS):
        (result / name).write_text("")
    assert {path.name for path in pictures_of(result)} == {*OURS}
    estimated(tmp_path / "stroke.npz", result, "--method", "lnorm")
    assert {path.name for path in result.iterdir()} == {*tables, *OTHERS}


def test_a_directory_without_a_result_has_none(tmp_path: Path) -> None:
    for content in (None, "{}", "old"):
        if content is not None:
            (tmp_path / "summary.json").write_text(content)
        (tmp_path / "views.svg").write_text("")
        assert pictures_of(tmp_path) == []
