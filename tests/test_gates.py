from __future__ import annotations

import os
import subprocess
from typing import TYPE_CHECKING

from gates import dear_constructs, long_modules, long_subjects, private_names, recent_subjects

if TYPE_CHECKING:
    from pathlib import Path


def test_a_long_module_is_named_unless_it_or_its_folder_is_exempt(tmp_path: Path) -> None:
    for name, lines in (("short.py", 300), ("long.py", 301), ("core/deep/long.py", 400), ("spare.py", 500)):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("\n" * lines)
    exempt = {"core": "why", "spare.py": "why"}
    assert long_modules(tmp_path, exempt) == ["long.py has 301 lines, at most 300"]
    assert long_modules(tmp_path, {**exempt, "long.py": "why", "short.py": "why"}) == [
        "short.py is exempt but has no module over 300 lines"
    ]


def test_a_long_subject_is_named_with_its_commit() -> None:
    assert long_subjects([f"1234567 {'x' * 72}", f"abcdef0 {'y' * 73}"]) == [
        f"commit abcdef0 {'y' * 73}: 73 characters, at most 72"
    ]


def test_without_git_or_its_history_no_subject_is_checked(tmp_path: Path) -> None:
    assert recent_subjects(tmp_path) == []
    origin, clone = tmp_path / "origin", tmp_path / "clone"
    origin.mkdir()
    identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run(["git", "init", "-q"], cwd=origin, check=True)
    for year, subject in ((2020, "old"), (2030, "a"), (2031, "b")):
        command = ["git", *identity, "commit", "-q", "--allow-empty", "-m", subject]
        dated = {**os.environ, "GIT_COMMITTER_DATE": f"{year}-01-01T00:00:00Z"}
        subprocess.run(command, cwd=origin, check=True, env=dated)
    assert [line.partition(" ")[2] for line in recent_subjects(origin)] == ["b", "a"]
    assert recent_subjects(origin / ".git") == []
    subprocess.run(["git", "clone", "-q", "--depth", "1", f"file://{origin}", str(clone)], check=True)
    assert recent_subjects(clone) == []


def test_a_construct_in_a_kernel_that_takes_long_to_compile_is_named(tmp_path: Path) -> None:
    source = """
@routine
def dear(a, b, record):
    c = a @ b
    a[1:] = b[:-1]
    a[:] = 0.0
    a[:], b[:] = 0.0, -1.0
    a[1:] = b
    a[1:] *= 2.0
    return np.median(c) + record.mean + np.linalg.norm(a)

def cheap(a, b):
    return a @ b
"""
    (tmp_path / "stage.py").write_text(source)
    end = "in a kernel takes long to compile; write a loop"
    filled = [(line, "a slice filled from an array") for line in ("5", "8", "9")]
    named = [("4", "@"), *filled, ("10", "median"), ("10", "linalg")]
    assert sorted(dear_constructs(tmp_path, {})) == sorted(f"stage.py:{line}: {what} {end}" for line, what in named)
    may = {"stage.py": dict.fromkeys(("@", "a slice filled from an array", "median", "linalg"), "why")}
    assert dear_constructs(tmp_path, may) == []
    assert dear_constructs(tmp_path, {"stage.py": {**may["stage.py"], "sort": "why"}}) == [
        "stage.py may use sort but does not"
    ]


def test_a_private_name_of_numba_is_named(tmp_path: Path) -> None:
    source = """
from numba.core import _helperlib, event
import numba.core.runtime._nrt_python
import numba, _own
from other import _private
routine = register_jitable(_nrt=False, nogil=True)
"""
    (tmp_path / "kernels.py").write_text(source)
    assert private_names(tmp_path) == [
        "kernels.py:2: numba.core._helperlib is private to numba",
        "kernels.py:3: numba.core.runtime._nrt_python is private to numba",
        "kernels.py:6: _nrt is private to numba",
    ]
