"""The package of docs/extending.md, taken from the page, registered by its entry points and used as the page says."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import taxelflow
from bagged import write_bag
from rigged import refused
from taxelflow.cli import main
from taxelflow.errors import NameUnknown, PluginBroken, SensorNeeded

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "extending.md").read_text()
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
FILES = {match[1]: block for _, block in BLOCKS if (match := re.match(r"# (\S+\.(?:py|toml))\n", block))}
COMMANDS = [line for kind, block in BLOCKS if kind == "sh" for line in block.splitlines()]


@pytest.fixture(autouse=True)
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files of the page in a current folder of their own, on the path, with the package installed."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    project = tomllib.loads(FILES["pyproject.toml"])["project"]
    installed = tmp_path / "my_touch-0.1.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: 0.1\n")
    groups = project["entry-points"]
    points = {group: [f"{name} = {value}" for name, value in own.items()] for group, own in groups.items()}
    text = "\n".join(f"[{group}]\n" + "\n".join(lines) for group, lines in points.items())
    (installed / "entry_points.txt").write_text(text + "\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "my_touch"]:
        monkeypatch.delitem(sys.modules, name)


def command(start: str) -> int:
    """Run the one command of the page that starts so."""
    [line] = [line for line in COMMANDS if line.startswith(f"taxelflow {start}")]
    return main(shlex.split(line)[1:])


def script(name: str) -> None:
    exec(compile(FILES[name], name, "exec"), {"__name__": "__main__"})


def test_every_block_of_the_page_is_run_here() -> None:
    assert {kind for kind, _ in BLOCKS} == {"toml", "python", "sh"}
    assert sum(kind != "sh" for kind, _ in BLOCKS) == len(FILES)
    assert [line.split()[1] for line in COMMANDS] == ["sensors", "simulate", "estimate", "estimate", "score"]


def test_the_sensor_is_drawn_and_simulated(capsys: pytest.CaptureFixture[str]) -> None:
    assert command("sensors") == 0
    assert "palm" in capsys.readouterr().out
    assert command("simulate") == 0
    assert taxelflow.read("stroke.npz").sensor.name == "my-palm"


def test_a_bag_of_the_packages_message_is_read() -> None:
    rows = np.arange(20 * 28.0).reshape(20, 28)
    write_bag(Path("touch.bag"), {"/touch": ("my_msgs/msg/Touch", [[row] for row in rows])})
    np.testing.assert_array_equal(taxelflow.read("touch.bag", "my-palm").load().values, rows)
    Path("my_touch/message.py").write_text("TOUCH = 28\n")
    del sys.modules["my_touch.message"]
    with pytest.raises(PluginBroken, match=r"cannot use message 'touch' .* it is a int, not a Kind"):
        taxelflow.read("touch.bag", "my-palm")


def test_the_reader_reads_what_was_written(capsys: pytest.CaptureFixture[str]) -> None:
    command("simulate")
    script("try_reader.py")
    assert capsys.readouterr().out.endswith("equal: True\n")
    assert command("estimate stroke.raw") == 0
    with pytest.raises(SensorNeeded):
        taxelflow.read("stroke.raw")
    with Path("stroke.raw").open("ab") as file:
        file.write(b"half")
    reading = taxelflow.read("stroke.raw", "my-palm").blocks()
    assert len(list(reading)) == 1
    assert reading.loss is not None


def test_a_reader_that_gives_no_recording_is_named_with_its_package() -> None:
    Path("my_touch/raw.py").write_text("def open_raw(path, sensor):\n    return [0.0]\n")
    Path("stroke.raw").write_bytes(b"1")
    with pytest.raises(PluginBroken, match=r"reader '.raw' from .* gives a list, not a Recording"):
        taxelflow.read("stroke.raw", "my-palm")


def test_the_estimator_reports_the_border_share_of_convolution(capsys: pytest.CaptureFixture[str]) -> None:
    command("simulate")
    capsys.readouterr()
    script("try_estimator.py")
    shares = dict(line.split(": ") for line in capsys.readouterr().out.splitlines())
    assert shares["centroid"] == shares["convolution"]
    assert not shares["centroid"].startswith("0%")
    ours, theirs = (taxelflow.estimate("stroke.npz", method) for method in ("centroid", "convolution"))
    for field in ("contact", "border", "load"):
        np.testing.assert_array_equal(getattr(ours.slips, field), getattr(theirs.slips, field))
    known = np.isfinite(ours.slips.pose[..., 0])
    np.testing.assert_array_equal(ours.slips.quality > 0, known)
    assert command("estimate stroke.npz") == 0


def test_the_score_runs_by_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert command("score") == 0
    printed = re.findall(r"^(press|tilt): ([\d.]+) mm$", capsys.readouterr().out, re.MULTILINE)
    assert [name for name, _ in printed] == ["press", "tilt"]
    assert float(printed[1][1]) > float(printed[0][1])
    heading, *rows = Path("still.csv").read_text().splitlines()
    assert heading == "scenario,rms_mm"
    assert len(rows) == len(printed)


def test_a_score_without_a_report_is_named_with_its_package(capsys: pytest.CaptureFixture[str]) -> None:
    text = FILES["my_touch/still.py"].replace("return StillReport(rows)", "return None")
    Path("my_touch/still.py").write_text(text.replace('("press", "tilt")', "()"))
    said = refused(capsys, "score", "still")
    assert "cannot use score 'still' from my_touch.still:Still (TypeError: it gives a NoneType, not a report" in said


def test_an_unknown_name_lists_those_of_the_package() -> None:
    with pytest.raises(NameUnknown, match="centroid"):
        taxelflow.estimator("centroids")
    with pytest.raises(NameUnknown, match="my-palm, a plain grid"):
        taxelflow.load_sensor("my-plam")


def test_the_sensor_of_the_package_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sensors"]) == 0
    assert "my-palm " in capsys.readouterr().out


def test_a_sensor_that_is_none_is_one_line_that_names_the_package() -> None:
    Path("my_touch/palm.py").write_text("def palm():\n    return 28\n")
    with pytest.raises(PluginBroken, match=r"'my-palm' from my_touch\.palm:palm .*int, not a .* the package my-touch"):
        taxelflow.load_sensor("my-palm")
