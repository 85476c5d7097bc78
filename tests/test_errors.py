from __future__ import annotations

import inspect
import pickle
import re
from pathlib import Path

import pytest

from taxelflow import errors
from taxelflow.errors import TaxelflowError

CLASSES = {name: kind for name, kind in vars(errors).items() if inspect.isclass(kind) and issubclass(kind, Exception)}
FACTS: dict[str, tuple[object, ...]] = {
    "RecordingMissing": (Path("a.npz"),),
    "RecordingsSeveral": ("a.npz", "b.npz"),
    "RecordingsAlike": ("a/x.npz", "b/x.npz", Path("out/x")),
    "BatchUnlike": (Path("out"), "method was 'lnorm', is 'sum'"),
    "ClusterFault": ("the scheduler was lost", "run the same command again"),
    "WordsInvalid": ("missing value for argument '--to'; see taxelflow run --help",),
    "FormatUnknown": (Path("a.xyz"), [".npz", ".csv"]),
    "RecordingCorrupt": (Path("a.npz"), "it is empty", "record it again"),
    "RecordingTruncated": (Path("a.dsa"), 7, 10, "end of file"),
    "TaxelCountWrong": (Path("a.npz"), 7, "hand", 10),
    "RecordingTooLarge": (Path("a.npz"), "it unpacks to 9 GB", "save it uncompressed"),
    "TimesNotIncreasing": (Path("a.npz"), 7, 2.0, 1.0),
    "SensorNeeded": (Path("a.npz"), ["hand"]),
    "TopicUnclear": (Path("a.bag"), "2 topics fit", ["/a (pkg/msg/Touch)", "/b (pkg/msg/Touch)"]),
    "SensorFileInvalid": ("hand.toml", "top level", "no name", "add one"),
    "PitchNeeded": ("hand", "3"),
    "GridNameInvalid": ("grid:4",),
    "NameUnknown": ("sensor", "hnad", ["hand"]),
    "ParameterInvalid": ("gain", 0, "be above 0"),
    "TipsOver": (),
    "ResultMissing": (Path("out"), "slips.csv"),
    "SourceMissing": (Path("out"), "a.npz"),
    "CalibrationInvalid": (Path("cal.toml"), "it is empty"),
    "CalibrationUnfit": ("sensor 'hand'", "sensor 'foot'"),
    "GainsUnknown": ("the object did not move", "move it"),
    "EstimatorBroken": ("MySession", "a list", "step must return Estimates"),
    "PluginBroken": ("estimator", "other", "plug:Other", "plug", RuntimeError("no\nlicence")),
    "PluginFailed": ("source", "other", "plug", ValueError("no\nmotor"), "plug.py, line 3"),
    "RunEnded": (),
    "TruthInvalid": (Path("truth.csv"), "it is empty"),
    "AddressInvalid": ("tcp:5000", "it has no host and port", "tcp://HOST:PORT"),
    "SourceUnreachable": ("tcp://127.0.0.1:5", "connection refused", 5.0),
    "SinkUnusable": ("jsonl:/none/a", "no such directory"),
    "PortTaken": ("tcp-listen://127.0.0.1:5000", 5000),
    "GraphicsMissing": ("egl: no library; osmesa: no library",),
    "ExtraMissing": ("plot", "matplotlib"),
}


def test_every_error_has_the_one_root() -> None:
    assert all(issubclass(kind, TaxelflowError) for kind in CLASSES.values())


def test_the_tree_at_the_top_of_the_file_is_the_tree_of_classes() -> None:
    drawn = {}
    path: list[str] = []
    for line in (errors.__doc__ or "").splitlines():
        found = re.match(r"([│├└─ ]*)(\w+)(?:\s{2,}|$)", line)
        if found and found[2] in CLASSES:
            depth = len(found[1]) // 4
            path = [*path[:depth], found[2]]
            drawn[found[2]] = path[-2] if depth else "Exception"
    assert drawn == {name: kind.__base__.__name__ for name, kind in CLASSES.items() if kind.__base__}


LEAVES = [name for name in CLASSES if name not in ("TaxelflowError", "RecordingError", "CalibrationError")]


@pytest.mark.parametrize("name", LEAVES)
def test_an_error_goes_from_one_process_to_another(name: str) -> None:
    error = CLASSES[name](*FACTS[name])
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert (str(again), vars(again)) == (str(error), vars(error))


@pytest.mark.parametrize("name", LEAVES)
def test_a_message_is_one_line_that_names_the_finding_and_the_remedy(name: str) -> None:
    message = str(CLASSES[name](*FACTS[name]))
    assert "\n" not in message
    assert all(str(fact) in message for fact in FACTS[name][:1])
    assert re.search(r"[;:]| must ", message)
    assert not message.endswith(".")
