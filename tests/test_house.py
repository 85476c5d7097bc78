from __future__ import annotations

import os
import re
import shutil
import stat
import subprocess
import tomllib
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
CONSTRAINTS = (CHECKOUT / "constraints.txt").read_text().splitlines()


def plain(name: str) -> str:
    """A distribution's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned() -> list[str]:
    return [plain(line.split("==")[0]) for line in CONSTRAINTS if not line.startswith("#")]


def test_a_constraint_is_a_name_and_a_version_and_nothing_else() -> None:
    for line in CONSTRAINTS:
        assert re.fullmatch(r"#.*|[A-Za-z0-9][A-Za-z0-9._-]*==[A-Za-z0-9.!+_-]+", line), line
        assert "://" not in line
    assert len(pinned()) > 20


def test_each_distribution_is_pinned_once() -> None:
    names = pinned()
    assert len(set(names)) == len(names)


def test_everything_that_is_asked_for_is_pinned() -> None:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
    asked = [
        *project["project"]["dependencies"],
        *(name for extra in project["project"]["optional-dependencies"].values() for name in extra),
        *project["build-system"]["requires"],
    ]
    names = {plain(re.split(r"[<>=!~\[; ]", requirement)[0]) for requirement in asked}
    assert names - set(pinned()) == set()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with .ci/run and, as `make`, a program that notes what it is asked for."""
    shutil.copytree(CHECKOUT / ".ci", tmp_path / "checkout" / ".ci")
    (tmp_path / "bin").mkdir()
    make = tmp_path / "bin" / "make"
    make.write_text('#!/bin/sh\necho "$PWD $*" >> "$NOTES"\ntest "$*" != "$BROKEN"\n')
    make.chmod(0o755)
    return tmp_path / "checkout"


def integrate(checkout: Path, broken: str = "") -> tuple[int, list[str]]:
    notes = checkout.parent / "notes"
    path = f"{checkout.parent / 'bin'}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [str(checkout / ".ci" / "run")],
        check=False,
        cwd="/",
        env={"PATH": path, "NOTES": str(notes), "BROKEN": broken},
    )
    return done.returncode, notes.read_text().splitlines()


def test_continuous_integration_may_be_run() -> None:
    assert (CHECKOUT / ".ci" / "run").stat().st_mode & stat.S_IXUSR


def test_continuous_integration_checks_and_tests_in_the_checkout(checkout: Path) -> None:
    assert integrate(checkout) == (0, [f"{checkout} {target}" for target in ("check", "test", "test-long")])


@pytest.mark.parametrize("broken", ["check", "test", "test-long"])
def test_continuous_integration_fails_with_any(checkout: Path, broken: str) -> None:
    code, asked = integrate(checkout, broken)
    assert code != 0
    assert asked[-1] == f"{checkout} {broken}"


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
@pytest.mark.parametrize(
    ("target", "programs"),
    [
        ("check", ["ruff format --check", "ruff check", "mypy", "lint-imports", "vulture"]),
        ("test", ["pytest"]),
        ("test-long", ["pytest -m long"]),
        ("demo", ["simulate", "estimate", "--method lnorm", "--method convolution", "plot", "score table1"]),
        ("bench", ["taxelflow bench"]),
        ("setup", []),
        ("format", ["ruff format"]),
    ],
)
def test_make_runs_what_its_targets_promise_after_setting_up(tmp_path: Path, target: str, programs: list[str]) -> None:
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(CHECKOUT / name, tmp_path)
    done = subprocess.run(
        ["make", "-n", target],
        check=True,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={"PATH": os.environ["PATH"]},  # none of the flags of a make that runs these tests
    )
    assert "constraint constraints.txt" in done.stdout
    place = 0
    for program in programs:
        place = done.stdout.index(program, place)
    assert list(tmp_path.glob(".venv")) == []
