from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from costly import mostly_long
from taxelflow.cli import main
from taxelflow.pipeline.api import read
from taxelflow.simulation.scenario import SCENARIOS

if TYPE_CHECKING:
    from pathlib import Path


def test_nested_parameters_are_options(tmp_path: Path) -> None:
    options = "--contact.feet-at-m 0 0 0.01 0.02 --motion.centre-m 0 0 --motion.strokes 2 --load.multiples 1 2"
    assert main(["simulate", "turn-over-hand", *options.split(), "--out", str(tmp_path / "a.npz")]) == 0
    recording = read(tmp_path / "a.npz")
    assert recording.truth is not None
    assert recording.truth.slipping is not None
    assert recording.truth.pad == "hand"
    with np.load(tmp_path / "a.npz") as members:
        assert '"feet_at_m": [[0.0, 0.0], [0.01, 0.02]]' in str(members["parameters"])


@pytest.mark.parametrize("name", mostly_long(SCENARIOS, "press", "stick-slip"))
def test_every_scenario_has_its_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        main(["simulate", name, "--help"])
    assert not done.value.code
    assert "--load.lift-s" in capsys.readouterr().out


def test_a_parameter_that_does_not_fit_is_one_calm_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "press", "--load.lift-s", "9", "--out", str(tmp_path / "a.npz")]) == 2
    assert capsys.readouterr().err == (
        "taxelflow: --load.lift-s must be at most motion.rest_s, 2 s: a moving object is in contact (got 9.0)\n"
    )
