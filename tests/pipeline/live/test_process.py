"""`taxelflow run` and `record` as processes: signals, kills, exit codes, and what stands on standard output."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import pytest

import taxelflow
from rigged import refused
from streaming import PALM, awaited, connected, free_port, lines, slid
from taxelflow.cli import main
from taxelflow.errors import TaxelflowError

if TYPE_CHECKING:
    from pathlib import Path

TOML = 'name = "hand"\nunit = "Pa"\n[[pads]]\nname = "pad0"\nrows = 4\ncols = 7\npitch_m = [0.01, 0.01]\n'
COMMAND = (sys.executable, "-m", "taxelflow.cli")


@pytest.fixture
def sensor(tmp_path: Path) -> str:
    (tmp_path / "hand.toml").write_text(TOML)
    return str(tmp_path / "hand.toml")


@pytest.mark.parametrize("words", [["run", "replay:{}?speed=max"], ["emulate", "tcp://127.0.0.1:0", "--from", "{}"]])
@pytest.mark.parametrize("header", ["t_s;a;b\n0;1;2\n", "t_s,a,note,b\n0,1,x,2\n"])
def test_a_table_that_needs_columns_is_to_be_converted_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], header: str
) -> None:
    """These commands take no --columns, which the reader's error asks for."""
    (tmp_path / "a.csv").write_text(header)
    command = [word.format(tmp_path / "a.csv") for word in words]
    said = refused(capsys, *command, "--sensor", "grid:1x2@4mm")
    assert " --columns." in said
    assert "this command takes no --columns: give them to `taxelflow convert`, and this command the .npz\n" in said


@pytest.mark.long
def test_lines_on_standard_input_become_json_lines_and_nothing_else_on_standard_output(sensor: str) -> None:
    done = subprocess.run(
        [*COMMAND, "run", "stdin:", "--sensor", sensor, "--to", "jsonl:-", "--quiet"],
        input=b"".join(lines(slid())),
        capture_output=True,
        timeout=100,
        check=True,
    )
    assert [json.loads(line)["t_s"] for line in done.stdout.splitlines()] == slid().t_s.tolist()
    assert b"scans in: 80" in done.stderr


@pytest.mark.long
@pytest.mark.parametrize("url", ["jsonl:/dev/stdout", "jsonl:a.jsonl"])
def test_totals_leave_a_file_alone_that_standard_output_is_redirected_to(url: str, sensor: str, tmp_path: Path) -> None:
    with (tmp_path / "a.jsonl").open("wb") as redirected:
        done = subprocess.run(
            [*COMMAND, "run", "stdin:", "--sensor", sensor, "--to", url],
            cwd=tmp_path,
            input=b"".join(lines(slid())),
            stdout=redirected,
            stderr=subprocess.PIPE,
            timeout=100,
            check=True,
        )
    written = (tmp_path / "a.jsonl").read_bytes().splitlines()
    assert [json.loads(line)["t_s"] for line in written] == slid().t_s.tolist()
    assert b"scans in: 80" in done.stderr


def scans_in(path: Path) -> int:
    """Scans that can be read of a recording that is being written."""
    try:
        return sum(len(block) for block in taxelflow.read(path).blocks())
    except TaxelflowError:
        return 0


@pytest.mark.long
@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_what_arrived_is_in_the_file_when_the_process_ends(
    tmp_path: Path, sensor: str, ending: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    port, out = free_port(), tmp_path / "a.mcap"
    command = [*COMMAND, "record", f"tcp-listen://127.0.0.1:{port}", str(out), "--sensor", sensor]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    with connected(port) as device:
        device.sendall(b"".join(lines(slid())))
        awaited(lambda: scans_in(out) == 80)  # that it takes a second at most, tests/killed.py counts
        device.sendall(b"".join(lines(slid(100))[80:]))
        if ending != signal.SIGKILL:
            time.sleep(0.1)
        os.kill(process.pid, ending)
        said, _ = process.communicate(timeout=20)
    assert main(["info", str(out), "--json"]) == (1 if ending == signal.SIGKILL else 0)
    found = capsys.readouterr()
    scans = json.loads(found.out)["scans"]
    if ending == signal.SIGKILL:
        assert scans >= 80
        assert "truncated" in found.err
    else:
        assert scans == 100
        assert process.returncode == 0
        assert b"scans in: 100" in said
    assert taxelflow.read(out).sensor.layout.pads == PALM.layout.pads


def test_bad_input_is_one_line_and_exit_code_2(tmp_path: Path, sensor: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "known are tcp" in refused(capsys, "run", "nowhere:", "--to", "jsonl:-")
    assert "known are tables" in refused(capsys, "run", "stdin:", "--sensor", sensor, "--to", "nothing:")
    assert "--sensor" in refused(capsys, "run", "tcp-listen://127.0.0.1:5", "--to", "jsonl:-")
    assert "end in .mcap" in refused(capsys, "record", "stdin:", tmp_path / "a.csv", "--sensor", sensor)
    assert "give replay:grasp.npz for a recording, or" in refused(capsys, "run", "grasp.npz")
    assert "give tables:out for a directory of tables, or" in refused(capsys, "run", "rig:stroke", "--to", "out")
    assert "unknown option 'x'; give no options" in refused(capsys, "run", "rig:stroke", "--to", "jsonl:a?x=1")
    assert "--max-scans must be 1 or more" in refused(
        capsys, "record", "stdin:", tmp_path / "a.mcap", "--max-scans", "0"
    )
    assert "above 0 s" in refused(capsys, "record", "stdin:", tmp_path / "a.mcap", "--duration", "0")
    assert "twice" in refused(capsys, "run", "rig:stroke", "--to", "jsonl:a", "--to", "jsonl:a")
    assert "own sensor" in refused(capsys, "run", "rig:stroke", "--sensor", sensor, "--to", "jsonl:a")


def test_a_source_that_is_not_there_is_refused_after_a_wait(
    tmp_path: Path, sensor: str, capsys: pytest.CaptureFixture[str]
) -> None:
    url = f"tcp://127.0.0.1:{free_port()}?wait=0"
    assert "Connection refused" in refused(capsys, "record", url, tmp_path / "a.mcap", "--sensor", sensor)
