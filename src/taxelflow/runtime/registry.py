"""Every exchangeable part by name: where a new reader, writer, estimator, sensor, source or sink is announced.

Built-in parts stand in these tables and are imported on use; other packages add theirs as entry points
of the group `taxelflow.<stage>`.
"""

from __future__ import annotations

import ast
import sys
from dataclasses import is_dataclass
from functools import lru_cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from traceback import walk_tb
from typing import TYPE_CHECKING, Any

from taxelflow.errors import NameUnknown, PluginBroken, PluginFailed, TaxelflowError

if TYPE_CHECKING:
    from collections.abc import Sequence

PARTS: dict[str, dict[str, str]] = {
    "reader": {
        ".npz": "taxelflow.acquire.npz:open_npz",
        ".csv": "taxelflow.acquire.csv:open_csv",
        ".dsa": "taxelflow.acquire.dsa:open_dsa",
        ".tsv": "taxelflow.acquire.csv:open_csv",
        ".txt": "taxelflow.acquire.csv:open_csv",
        ".bag": "taxelflow.acquire.ros.open:open_bag",
        ".db3": "taxelflow.acquire.ros.open:open_bag",
        ".mcap": "taxelflow.acquire.ros.open:open_bag",
        ".parquet": "taxelflow.acquire.parquet:open_parquet",
        ".npy": "taxelflow.acquire.npy:open_npy",
        ".h5": "taxelflow.acquire.hdf5:open_hdf5",
        ".hdf5": "taxelflow.acquire.hdf5:open_hdf5",
        "metadata.yaml": "taxelflow.acquire.ros.open:open_bag",
        "folder": "taxelflow.acquire.padfiles:open_pads",
    },
    "writer": {
        ".npz": "taxelflow.acquire.npz:write_npz",
        ".csv": "taxelflow.acquire.csv:write_csv",
        ".parquet": "taxelflow.acquire.parquet:write_parquet",
        ".mcap": "taxelflow.acquire.ros.write:write_mcap",
    },
    "estimator": {
        "lnorm": "taxelflow.estimation.centroid.lnorm:LNorm",
        "convolution": "taxelflow.estimation.centroid.convolution:Convolution",
        "template": "taxelflow.estimation.template.parameters:Template",
        "registration": "taxelflow.estimation.scan_matching.parameters:Registration",
        "sum": "taxelflow.estimation.centroid.load_sum:Sum",
        "principal_axis": "taxelflow.estimation.centroid.principal_axis:PrincipalAxis",
    },
    "sensor": {},  # built-in ones are the files of `sensors/data`
    "message": {},  # built-in ones are the table of `acquire/ros/kinds`
    "source": {
        "tcp": "taxelflow.acquire.devices.tcp:connect",
        "tcp-listen": "taxelflow.acquire.devices.tcp:listen",
        "udp-listen": "taxelflow.acquire.devices.udp:listen",
        "serial": "taxelflow.acquire.devices.serial:connect",
        "stdin": "taxelflow.acquire.devices.stdin:read",
        "ros2": "taxelflow.acquire.devices.dds:connect",
        "rosbridge": "taxelflow.acquire.devices.rosbridge:connect",
        "lsl": "taxelflow.acquire.devices.lsl:connect",
        "inspire-modbus": "taxelflow.acquire.devices.inspire:connect",
        "inspire-dds": "taxelflow.acquire.devices.dds:inspire",
        "xela": "taxelflow.acquire.devices.xela:connect",
        "dsa": "taxelflow.acquire.devices.dsa:connect",
        "barrett-can": "taxelflow.acquire.devices.barrett:connect",
        "replay": "taxelflow.pipeline.live.replay:replay",
        "rig": "taxelflow.pipeline.live.replay:rig",
    },
    "emulator": {
        "tcp": "taxelflow.pipeline.live.emulators.streams:TcpServer",
        "tcp-listen": "taxelflow.pipeline.live.emulators.streams:TcpClient",
        "udp-listen": "taxelflow.pipeline.live.emulators.streams:UdpSender",
        "serial": "taxelflow.pipeline.live.emulators.streams:SerialDevice",
        "stdin": "taxelflow.pipeline.live.emulators.streams:StandardOutput",
        "ros2": "taxelflow.pipeline.live.emulators.ros:Ros2",
        "rosbridge": "taxelflow.pipeline.live.emulators.ros:Rosbridge",
        "lsl": "taxelflow.pipeline.live.emulators.lsl:Lsl",
        "inspire-modbus": "taxelflow.pipeline.live.emulators.devices:Inspire",
        "inspire-dds": "taxelflow.pipeline.live.emulators.ros:InspireDds",
        "xela": "taxelflow.pipeline.live.emulators.devices:Xela",
        "dsa": "taxelflow.pipeline.live.emulators.devices:Dsa",
        "barrett-can": "taxelflow.pipeline.live.emulators.devices:Barrett",
    },
    "sink": {
        "tables": "taxelflow.publish.sinks.tables:write",
        "parquet": "taxelflow.publish.sinks.parquet:write",
        "mcap": "taxelflow.pipeline.live.mcap_sink:write",
        "jsonl": "taxelflow.publish.sinks.jsonl:write",
        "jsonl-listen": "taxelflow.publish.sinks.jsonl:listen",
        "ros2": "taxelflow.pipeline.live.ros2_sink:write",
        "lsl": "taxelflow.pipeline.live.lsl_sink:write",
        "foxglove": "taxelflow.publish.sinks.foxglove:listen",
    },
    "controller": {
        "hold": "taxelflow.control.hold:Hold",
        "constant": "taxelflow.control.baselines:Constant",
        "threshold": "taxelflow.control.baselines:Threshold",
        "centroid": "taxelflow.control.baselines:CentroidSpeed",
        "slide": "taxelflow.control.motion:Slide",
        "pivot": "taxelflow.control.motion:Pivot",
    },
    "drawing": {
        "results": "taxelflow.evaluation.plot:plot_results",
    },
    "score": {
        "table1": "taxelflow.evaluation.table1:Table1",
        "hard": "taxelflow.evaluation.hard:Hard",
        "field": "taxelflow.evaluation.field:Field",
        "slip": "taxelflow.evaluation.slip:Slip",
        "hand": "taxelflow.evaluation.hand:Hand",
        "limits": "taxelflow.evaluation.limits:Limits",
        "peers": "taxelflow.evaluation.peers:Peers",
        "contacts": "taxelflow.evaluation.contacts:Contacts",
        "prediction": "taxelflow.evaluation.prediction:Prediction",
        "robustness": "taxelflow.evaluation.robustness:Robustness",
        "xela": "taxelflow.evaluation.xela:Xela",
        "live": "taxelflow.evaluation.live_bench:LiveBench",
        "view": "taxelflow.evaluation.view_bench:ViewBench",
        "batch": "taxelflow.evaluation.batch_workers:BatchWorkers",
    },
}

_KINDS = {"estimator": "method"}
"""What the command line calls a part of a stage, where that is not the stage's name."""
_CALLED_WITH: dict[str, tuple[str, ...]] = {
    "reader": ("path", "sensor"),
    "writer": ("recording", "path", "blocks"),
    "source": ("address", "sensor"),
    "sink": ("address",),
    "sensor": (),
}
"""What a part of these stages is called with."""
_METHODS: dict[str, tuple[str, ...]] = {"estimator": ("start", "layout", "mode"), "score": ("run", "watched")}
"""The method that a class of these stages needs, and what it is called with."""


def names(stage: str) -> list[str]:
    """Known names of a stage, built-in ones first."""
    return [*PARTS[stage], *sorted(_plugins(stage))]


def check(stage: str, name: str) -> None:
    """Raises NameUnknown, with the list of names, for a part that does not exist; nothing is imported."""
    if name not in names(stage):
        raise NameUnknown(_KINDS.get(stage, stage), name, names(stage))


def find(stage: str, name: str) -> Any:
    """The part of that name, imported now. Raises NameUnknown with the list of names, PluginBroken."""
    if name in PARTS[stage]:
        module, _, attribute = PARTS[stage][name].partition(":")
        return getattr(import_module(module), attribute)
    check(stage, name)
    try:
        part = _plugins(stage)[name].load()
        _check_form(stage, part)
    except TaxelflowError:  # such as a missing extra
        raise
    except Exception as error:  # whatever stands in another's module
        raise broken(stage, name, error) from error
    return part


def _check_form(stage: str, part: Any) -> None:
    """Raises TypeError for a part of another package that cannot be called as its stage calls it."""
    name = getattr(part, "__name__", f"{part!r}")
    if stage in _METHODS and isinstance(part, type):
        method, *words = _METHODS[stage]
        if stage == "estimator" and not is_dataclass(part):
            raise TypeError(f"{name} is no dataclass")
        if not hasattr(part, method):
            raise TypeError(f"{name} has no method {method}")
        _check_call(getattr(part, method), f"{name}.{method}", words, ["self"])
    elif stage in _CALLED_WITH and not (stage == "sensor" and not callable(part)):
        _check_call(part, name, _CALLED_WITH[stage], [])
    elif stage in _METHODS and not callable(part):
        raise TypeError(f"{name} is no class")


def _check_call(called: Any, name: str, words: Sequence[str], before: list[str]) -> None:
    """Raises TypeError for what does not take arguments of this meaning. before: what Python passes before them."""
    try:
        signature(called).bind(*before, *words)
    except TypeError as error:
        raise TypeError(f"{name} must take {', '.join(words) or 'nothing'}: {error}") from error
    except ValueError:  # of a function in C: its signature is unknown
        return


def broken(stage: str, name: str, error: Exception) -> PluginBroken:
    """The error for a part of another package that cannot be used."""
    point = _plugins(stage)[name]
    return PluginBroken(stage, name, point.value, _package(point), error)


def failed(error: BaseException, words: Sequence[str] = ()) -> PluginFailed | None:
    """The error that names the part of another package in which an exception arose; None if it arose elsewhere.

    words: of the command line, which name the part that ran where a package has several.
    """
    frames = [(frame.f_globals.get("__name__", ""), frame, line) for frame, line in walk_tb(error.__traceback__)][::-1]
    points = [(stage, point) for stage in PARTS for point in _plugins(stage).values()]
    packages = {point.module.partition(".")[0] for _, point in points} - {__name__.partition(".")[0]}
    theirs = [one for one in frames if one[0].partition(".")[0] in packages]
    if not theirs:
        return None
    modules, (module, frame, line) = [name for name, *_ in theirs], theirs[0]
    alike = [one for one in points if one[1].module.partition(".")[0] == module.partition(".")[0]]
    stage, point = max(alike, key=lambda one: (any(one[1].name in word for word in words), one[1].module in modules))
    return PluginFailed(
        stage, point.name, _package(point), error, f"{Path(frame.f_code.co_filename).name}, line {line}"
    )


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist else "?"


def summary(stage: str, name: str) -> str:
    """First line of a part's docstring, read from its source file: the part itself is not imported.

    Empty if there is no source that can be read, or no docstring.
    """
    where = PARTS[stage].get(name) or _plugins(stage)[name].value
    module, _, attribute = where.partition(":")
    try:
        found = find_spec(module)
        if found is None or found.origin is None or not found.origin.endswith(".py"):
            return ""
        body = ast.parse(Path(found.origin).read_text(encoding="utf-8")).body
    except (ImportError, OSError, SyntaxError, ValueError):  # another's package is broken: help is given all the same
        return ""
    for node in body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == attribute:
            return (ast.get_docstring(node) or "").partition("\n")[0]
    return ""


def _plugins(stage: str) -> dict[str, EntryPoint]:
    return _installed(stage, tuple(sys.path))


@lru_cache(maxsize=32)
def _installed(stage: str, _path: tuple[str, ...]) -> dict[str, EntryPoint]:
    """Entry points of the packages on this path: to find them, a file of each package is read, which takes 20 ms."""
    return {point.name: point for point in entry_points(group=f"taxelflow.{stage}")}
