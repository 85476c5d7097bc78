from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

from taxelflow.errors import ExtraMissing
from taxelflow.publish.plots.style import LOOK, look, save, styled, widened

if TYPE_CHECKING:
    from pathlib import Path

SIGNATURES = {"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}


@pytest.mark.parametrize("form", SIGNATURES)
def test_a_figure_becomes_one_file_of_its_form_and_is_forgotten(tmp_path: Path, form: str) -> None:
    path, before = tmp_path / f"a.{form}", plt.get_fignums()
    with styled():
        figure, axis = plt.subplots()
        axis.plot([0, 1], [0, 1])
        assert save(figure, path) == path
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes().startswith(SIGNATURES[form])
    assert plt.get_fignums() == before


def test_letters_that_the_font_lacks_stay_text_without_a_warning(tmp_path: Path) -> None:
    with styled():
        figure, axis = plt.subplots()
        axis.set_title("日本語")
        path = save(figure, tmp_path / "a.svg")
    assert "日本語" in path.read_text(encoding="utf-8")


def test_a_name_with_dollars_is_no_formula(tmp_path: Path) -> None:
    with styled():
        figure, axis = plt.subplots()
        axis.set_title(r"pad $\nonsense$ of 5$")
        path = save(figure, tmp_path / "a.svg")
    assert r"pad $\nonsense$ of 5$" in path.read_text(encoding="utf-8")


def test_a_failure_while_writing_leaves_the_older_picture_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    path.write_text("older")
    with styled():
        figure, axis = plt.subplots()
        axis.set_title(r"$\nonsense$", parse_math=True)
        with pytest.raises(ValueError, match="nonsense"):
            save(figure, path)
        plt.close(figure)
    assert path.read_text() == "older"


def test_the_look_is_put_back_afterwards() -> None:
    before = dict(mpl.rcParams)
    with styled():
        assert mpl.rcParams["svg.hashsalt"] == "taxelflow"
        assert mpl.rcParams["font.size"] != before["font.size"]
    after = dict(mpl.rcParams)
    assert {name for name in before if before[name] != after[name]} <= {"backend"}


def test_no_window_is_needed() -> None:
    with styled():
        assert mpl.get_backend().lower() == "agg"


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ExtraMissing, match=r"matplotlib is not installed; .*pip install 'taxelflow\[plot\]'"), styled():
        pass


def test_methods_differ_in_label_colour_and_mark() -> None:
    looks = [look(method) for method in (*LOOK, "another")]
    for part in ("label", "color", "marker"):
        assert len({style[part] for style in looks}) == len(looks)
    assert looks[-1]["label"] == "another"


def test_a_log_axis_is_widened_about_its_middle_only_where_it_is_short() -> None:
    assert widened((4.0, 4.0), 4.0) == (2.0, 8.0)
    assert widened((1.0, 9.0), 4.0) == (1.0, 9.0)
