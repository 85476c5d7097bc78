"""Scenarios of the rig changed in a few fields, and tracks and results made of them for tests."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.cli import main
from taxelflow.publish.results import Track
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from taxelflow.messages import Bools, Floats
    from taxelflow.simulation.scenario import Scenario


def rigged(name: str = "stroke", **changes: Any) -> Scenario:
    """A named scenario; a mapping for contact, motion or sensing changes the fields that it names."""
    scenario = SCENARIOS[name]
    whole = {
        part: replace(getattr(scenario, part), **change) if isinstance(change, dict) else change
        for part, change in changes.items()
    }
    return replace(scenario, **whole)


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line on stderr of a command that ends with exit code 2 and prints nothing else."""
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    said = capsys.readouterr()
    assert (code, said.out) == (2, ""), said
    assert said.err.startswith("taxelflow: ")
    assert said.err.endswith("\n")
    assert said.err.count("\n") == 1, said.err
    return said.err


def estimated(recording: Path, out: Path, *arguments: str) -> Path:
    """The directory that `taxelflow estimate` writes for a recording."""
    assert main(["estimate", str(recording), "--out", str(out), *arguments]) == 0
    return out


def strokes_by_both(folder: Path, scenario: Scenario | None = None) -> list[Path]:
    """Result directories of one simulated recording by both of the paper's methods."""
    recording = folder / "stroke.npz"
    save(scenario or rigged(), recording)
    return [estimated(recording, folder / method, "--method", method) for method in ("lnorm", "convolution")]


def track(
    x_m: Floats,
    y_m: Floats,
    *,
    t_s: Floats | None = None,
    lag_s: float = 0.0,
    method: str = "lnorm",
    pad: str = "palm",
    contact: Bools | None = None,
    slipping: Bools | None = None,
    ok: Bools | None = None,
) -> Track:
    """Positions at 10 Hz from 0 s, ok, in contact and not slipping by default."""
    seconds = np.arange(len(x_m)) / 10 if t_s is None else t_s
    flags = {
        "contact": np.ones(len(x_m), dtype=np.bool_) if contact is None else contact,
        "slipping": np.zeros(len(x_m), dtype=np.bool_) if slipping is None else slipping,
        "ok": np.ones(len(x_m), dtype=np.bool_) if ok is None else ok,
    }
    numbers = {"t_s": seconds, "x_m": x_m, "y_m": y_m, "lag_s": np.full(len(x_m), lag_s)}
    return Track(method, pad, numbers, flags)


def svg_words(picture: Path) -> list[str]:
    """Texts of an SVG in the order in which they stand there."""
    import xml.etree.ElementTree as ET

    return ["".join(text.itertext()) for text in ET.parse(picture).iter("{http://www.w3.org/2000/svg}text")]
