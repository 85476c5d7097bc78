from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from browsed import installed_browser
from rigged import refused, rigged
from taxelflow.acquire.base import Recording
from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.view_film import Part, film_recording
from taxelflow.pipeline.api import convert, read
from taxelflow.publish.view.palette import DARK
from taxelflow.simulation.simulate import save


def test_the_scene_of_a_part_of_a_recording_is_filmed(stroke: Recording, tmp_path: Path) -> None:
    from imageio.v3 import imread

    installed_browser()
    middle_s = float(np.median([block.t_s[0] for block in stroke]) - next(iter(stroke)).t_s[0])
    part = Part(middle_s, middle_s + 0.3, fps=5.0)
    assert film_recording(stroke, ("convolution",), tmp_path / "scene.gif", part) == 2
    frames = imread(tmp_path / "scene.gif")
    assert frames.shape[:3] == (2, 720, 1280)
    assert np.ptp(frames[0].reshape(-1, 3), axis=0).min() > 100  # pressure has colour
    assert np.any(frames[0] != frames[1])
    edges = np.concatenate([frames[:, [0, -1]].reshape(-1, 3), frames[:, :, [0, -1]].reshape(-1, 3)])
    assert np.abs(edges.astype(int) - DARK.background).max() < 16  # the background fills the picture


@pytest.mark.long
def test_the_background_of_a_tall_hand_fills_its_film(tmp_path: Path) -> None:
    from imageio.v3 import imread

    installed_browser()
    save(rigged("slide-and-turn"), tmp_path / "slide.npz")
    film_recording(read(tmp_path / "slide.npz"), ("sum",), tmp_path / "scene.gif", Part(0.0, 0.1, fps=5.0))
    frames = imread(tmp_path / "scene.gif").astype(int)
    assert np.abs(frames[:, [0, -1]] - DARK.background).max() < 16


def test_a_part_that_is_none_is_refused(stroke: Recording, tmp_path: Path) -> None:
    installed_browser()
    for part in (Part(from_s=-1.0), Part(fps=0.0)):
        with pytest.raises(ParameterInvalid):
            film_recording(stroke, ("convolution",), tmp_path / "scene.gif", part)


def test_without_a_browser_the_error_names_what_to_install(
    stroke: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    convert(stroke, tmp_path / "stroke.npz")
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    said = refused(capsys, "view", tmp_path / "stroke.npz", "--film", tmp_path / "scene.gif")
    assert "no browser is installed" in said
    assert "apt install chromium" in said
