from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigged import refused
from synthetic import grid_sensor
from tabled import GOOD, parse
from taxelflow.errors import SensorFileInvalid, TaxelflowError, printable
from taxelflow.pipeline.api import read
from taxelflow.sensors.names import safe_name

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("name", ["=1+1", "+x", "-x", "@sum", "a\\u001b[2Jb", "a\\nb", "a\\u202eb", "a\\u009bb"])
@pytest.mark.parametrize("field", ["hand", "palm"])
def test_a_sensor_file_with_an_unsafe_name_is_refused(field: str, name: str) -> None:
    with pytest.raises(SensorFileInvalid, match="field name") as caught:
        parse(GOOD.replace(f'"{field}"', f'"{name}"', 1))
    assert str(caught.value).isprintable()


def test_such_a_file_ends_the_command_with_exit_code_2(capsys: Any, tmp_path: Path) -> None:
    path = tmp_path / "hand.toml"
    path.write_text(GOOD.replace('"palm"', '"=cmd"'))
    assert "'=cmd' begins with '=', as a spreadsheet's formula does" in refused(capsys, "sensors", path)


def test_a_name_that_would_end_a_column_is_refused_in_words() -> None:
    for name in ("a, b", 'a \\"b\\"'):
        with pytest.raises(SensorFileInvalid, match="expected text in one line without comma and quotation mark, got"):
            parse(GOOD.replace('"palm"', f'"{name}"'))


def test_a_note_may_have_lines_and_no_control_characters() -> None:
    parse('note = "a\\nb"\n' + GOOD)
    with pytest.raises(SensorFileInvalid, match=r"field note: .*control character"):
        parse('note = "a\\u001bb"\n' + GOOD)


@pytest.mark.long
@given(name=st.text(min_size=1))
def test_a_safe_name_is_one_line_and_no_formula(name: str) -> None:
    safe = safe_name(name)
    assert safe.isprintable()
    assert not safe.startswith(("=", "+", "-", "@"))
    assert safe_name(safe) == safe


def test_names_inside_a_recording_are_escaped(tmp_path: Path) -> None:
    sensor = json.loads(msgspec.json.encode(grid_sensor(2, 2, pads=2)))
    sensor["name"], sensor["note"] = "=s\x1b[2J", "\x1b]0;x\x07"
    sensor["pads"][0]["name"] = "@p\n"
    sensor["groups"] = [{"name": "-g", "patches": [{"pad": "@p\n"}]}]
    truth: dict[str, Any] = {"truth_pad": "@p\n", "truth_t_s": np.zeros(1), "truth_pose": np.zeros((1, 3))}
    np.savez(tmp_path / "a.npz", t=np.arange(3.0), pressure=np.zeros((3, 8)), sensor=json.dumps(sensor), **truth)
    recording = read(tmp_path / "a.npz")
    assert recording.sensor.name == "'=s\\x1b[2J"
    assert recording.layout.pads == ("'@p\\n", "pad1", "'-g")
    assert recording.sensor.note == "\\x1b]0;x\\x07"
    assert recording.known_truth.pad == "'@p\\n"


def test_messages_of_errors_are_one_printable_line() -> None:
    assert str(TaxelflowError("a\x1b[2J\nb")) == "a\\x1b[2J\\nb"
    assert len(str(TaxelflowError("x" * 10**6))) < 5000
    assert printable("plain ü") == "plain ü"
