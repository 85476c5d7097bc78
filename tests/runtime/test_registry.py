from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING

import pytest

from rigged import refused
from taxelflow.cli import main
from taxelflow.errors import NameUnknown, ParameterInvalid, PluginBroken
from taxelflow.estimation.centroid.convolution import Convolution
from taxelflow.estimation.centroid.lnorm import LNorm
from taxelflow.estimation.scan_matching.parameters import Registration
from taxelflow.pipeline.api import estimate, estimator
from taxelflow.pipeline.live.command import opened_sinks
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


@pytest.mark.parametrize(
    ("module", "seen"),
    [
        ("raise RuntimeError('no\\nlicence')", "RuntimeError: no licence"),
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("def broken(:", "SyntaxError: "),
        ("Another = 1", "AttributeError: module 'plug_for_taxelflow' has no attribute 'Other'"),
        (None, "ModuleNotFoundError: No module named 'plug_for_taxelflow'"),
    ],
)
def test_a_plugin_that_cannot_be_imported_is_named_in_one_line(
    plugin: str, module: str | None, seen: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "site" / "plug_for_taxelflow.py"
    file.unlink() if module is None else file.write_text(module)
    (tmp_path / "a.csv").write_text("t_s,v0,v1\n0,1,1\n")
    said = refused(capsys, "estimate", tmp_path / "a.csv", "--sensor", "grid:1x2@4mm", "--method", plugin, "--out", "x")
    assert f"cannot use estimator 'other' from plug_for_taxelflow:Other ({seen}" in said
    assert said.endswith("; repair or remove the package plug\n")
    assert registry.summary("estimator", plugin) == ""


def test_help_survives_a_plugin_whose_package_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("gone", "no_such_package.module:Score", "taxelflow.score")
    monkeypatch.setattr(registry, "_plugins", lambda _stage: {"gone": point})
    assert registry.summary("score", "gone") == ""


@pytest.mark.parametrize(
    ("stage", "where", "seen"),
    [
        ("reader", "math:sqrt", "sqrt must take path, sensor: too many positional arguments"),
        ("writer", "os.path:relpath", "relpath must take recording, path, blocks: too many positional arguments"),
        ("source", "textwrap:dedent", "dedent must take address, sensor: too many positional arguments"),
        ("sensor", "textwrap:dedent", "dedent must take nothing: missing a required argument: 'text'"),
        ("estimator", "math:pi", "3.141592653589793 is no class"),
        ("estimator", "fractions:Fraction", "Fraction is no dataclass"),
        ("estimator", "taxelflow:Sensor", "Sensor is no dataclass"),
        ("estimator", "taxelflow:Columns", "Columns has no method start"),
        ("estimator", "taxelflow:Conditioner", "Conditioner.start must take layout, mode: missing a required"),
        ("score", "taxelflow:Columns", "Columns has no method run"),
    ],
)
def test_a_plugin_that_its_stage_cannot_call_is_refused_by_name(
    stage: str, where: str, seen: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    point = EntryPoint("plug", where, f"taxelflow.{stage}")
    monkeypatch.setattr(registry, "_plugins", lambda asked: {"plug": point} if asked == stage else {})
    with pytest.raises(PluginBroken) as raised:
        registry.find(stage, "plug")
    assert str(raised.value).startswith(f"cannot use {stage} 'plug' from {where} (")
    assert seen in str(raised.value)


def test_a_plugin_whose_signature_python_does_not_know_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_plugins", lambda _stage: {"plug": EntryPoint("plug", "builtins:min", "")})
    assert registry.find("sink", "plug") is min


def test_a_sink_that_lacks_a_part_of_its_protocol_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("screen", "contextlib:nullcontext", "taxelflow.sink")
    monkeypatch.setattr(registry, "_plugins", lambda _stage: {"screen": point})
    with pytest.raises(PluginBroken, match=r"sink 'screen' .*its nullcontext has no lossless, raw, .*hurry, close\)"):
        opened_sinks(("screen:main",))
