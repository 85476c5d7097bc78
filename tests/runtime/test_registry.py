from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest

from taxelflow.cli import main
from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.estimation.centroid.convolution import Convolution
from taxelflow.estimation.centroid.lnorm import LNorm
from taxelflow.estimation.scan_matching.parameters import Registration
from taxelflow.pipeline.api import estimate, estimator
from taxelflow.runtime import registry

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording

PLUGIN = """
from dataclasses import dataclass
from taxelflow.estimation.centroid.lnorm import LNorm
from taxelflow.estimation.scan_matching.parameters import Registration

@dataclass(frozen=True)
class Other(LNorm):
    "The largest taxel under another name."
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A package that is not taxelflow's announces an estimator, as pip would install it."""
    package = tmp_path / "site"
    (package / "plug-1.0.dist-info").mkdir(parents=True)
    (package / "plug_for_taxelflow.py").write_text(PLUGIN)
    (package / "plug-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: plug\nVersion: 1.0\n")
    (package / "plug-1.0.dist-info" / "entry_points.txt").write_text(
        "[taxelflow.estimator]\nother = plug_for_taxelflow:Other\n"
    )
    monkeypatch.syspath_prepend(package)
    monkeypatch.delitem(sys.modules, "plug_for_taxelflow", raising=False)
    return "other"


def test_every_part_in_the_table_can_be_imported() -> None:
    for stage in registry.PARTS:
        for name in registry.names(stage):
            assert callable(registry.find(stage, name))


def test_the_papers_methods_have_their_names() -> None:
    assert registry.find("estimator", "lnorm") is LNorm
    assert registry.find("estimator", "convolution") is Convolution


def test_ours_and_the_baselines_have_their_names() -> None:
    names = ["lnorm", "convolution", "template", "registration", "sum", "principal_axis"]
    assert registry.names("estimator")[: len(names)] == names
    assert registry.find("estimator", "registration") is Registration


def test_an_unknown_name_comes_with_the_list() -> None:
    with pytest.raises(NameUnknown, match=r"unknown method 'magic'; known are lnorm, convolution"):
        registry.find("estimator", "magic")


def test_an_estimator_takes_its_parameters_by_name() -> None:
    assert estimator("lnorm", gain=2.0) == LNorm(gain=2.0)
    with pytest.raises(ParameterInvalid, match=r"lnorm.*gian"):
        estimator("lnorm", gian=2.0)
    with pytest.raises(ParameterInvalid, match="gain"):
        estimator("lnorm", gain=-2.0)
    with pytest.raises(ParameterInvalid, match="gain"):
        estimator("lnorm", gain="large")


def test_another_package_can_bring_an_estimator(plugin: str, stroke: Recording) -> None:
    assert plugin in registry.names("estimator")
    assert estimate(stroke, plugin, gain=2.0).summary.method == plugin
    with pytest.raises(NameUnknown, match=r"lnorm, convolution, .*other"):
        registry.find("estimator", "magic")


def test_the_command_line_knows_the_estimators_of_other_packages(
    plugin: str, recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa"
    assert main(["estimate", str(file), "--out", str(tmp_path / "out"), "--method", plugin, "--gain", "2"]) == 0
    assert '"gain": 2.0' in (tmp_path / "out" / "summary.json").read_text()
