from __future__ import annotations

import itertools
import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

from taxelflow import compiling
from taxelflow.compiling import kernel

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

MODULE = """
from taxelflow.compiling import kernel

@kernel
def twice(x: float) -> float:
    return 2.0 * x

@kernel
def thrice(x: float) -> float:
    return 3.0 * x
"""

PROGRAM = """
import logging
logging.basicConfig(format="%(name)s|%(levelname)s|%(message)s")
from kernels import thrice, twice
from taxelflow.compiling import announced
if {inside}:
    with announced():
        print(twice(1.5), thrice(1.5), twice(1), thrice(1))
else:
    print(twice(1.5), thrice(1.5), twice(1), thrice(1))
with announced():
    print(twice(2.5))
"""


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], Any]:
    """`kernel`, but compiled as it says now, not loaded as it said when a test was run before."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    return kernel


def said(folder: Path, *, inside: bool = True) -> list[str]:
    """Lines on stderr of a fresh process that calls two kernels."""
    (folder / "kernels.py").write_text(MODULE)
    paths = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM.format(inside=inside)],
        check=True,
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "NUMBA_CACHE_DIR": str(folder / "cache")},
    )
    assert done.stdout == "3.0 4.5 2.0 3.0\n5.0\n"
    return done.stderr.splitlines()


def test_the_first_compile_is_announced_once_and_a_cached_load_stays_silent(tmp_path: Path) -> None:
    (line,) = said(tmp_path)
    logger, level, message = line.split("|")
    assert (logger, level) == ("taxelflow", "WARNING")
    assert "compiling" in message
    assert list((tmp_path / "cache").rglob("*.nbi"))
    assert said(tmp_path) == []


def test_outside_of_the_context_nothing_is_announced(tmp_path: Path) -> None:
    assert said(tmp_path, inside=False) == []


def test_a_kernel_is_compiled_without_python_and_its_lock(fresh: Callable[[Any], Any]) -> None:
    @fresh
    def total(values: np.ndarray) -> float:
        found = 0.0
        for value in values:
            found += value
        return found

    assert isinstance(total, CPUDispatcher)
    assert total.targetoptions["nopython"]
    assert total.targetoptions["nogil"]


def test_sums_may_be_reordered_but_nan_stays_nan_and_zero_divides(fresh: Callable[[Any], Any]) -> None:
    @fresh
    def shares(values: np.ndarray) -> tuple[float, float]:
        found = 0.0
        for value in values:
            found += value
        return found, values[0] / found

    found, share = shares(np.array([1.0, -1.0]))
    assert (found, share) == (0.0, np.inf)
    found, _ = shares(np.array([1.0, np.nan, 2.0]))
    assert np.isnan(found)


def test_a_kernel_is_compiled_anew_when_another_has_changed(
    fresh: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def misses(sources: str) -> int:
        monkeypatch.setattr(compiling, "_sources", lambda: sources)

        @fresh
        def twice(x: float) -> float:
            return 2.0 * x

        assert twice(1.5) == 3.0
        return sum(twice.stats.cache_misses.values())

    assert [misses(sources) for sources in ("old", "old", "new", "new")] == [1, 0, 1, 0]


def test_files_with_kernels_and_what_they_know_of_messages_date_them(tmp_path: Path) -> None:
    kernels, messages, other = (tmp_path / name for name in ("kernels.py", "messages.py", "other.py"))
    seen = []
    for path, text in (
        (kernels, MODULE),
        (other, "X = 1"),
        (messages, "OK = 1"),
        (kernels, MODULE + "TWO = 2"),
        (messages, "OK = 2"),
        (other, "X = 2"),
    ):
        path.write_text(text)
        seen.append(compiling.hash_of(tmp_path))
    assert [now != before for before, now in itertools.pairwise(seen)] == [False, True, True, True, False]


def test_a_kernel_may_ask_whether_a_number_is_one(fresh: Callable[[Any], Any]) -> None:
    @fresh
    def unknown(values: np.ndarray) -> int:
        found = 0
        for value in values:
            found += np.isnan(value)
        return found

    assert unknown(np.array([1.0, np.nan, np.inf, np.nan])) == 2


@pytest.mark.parametrize("size", [0, 1, 1001])
def test_a_reordered_sum_is_still_a_sum(fresh: Callable[[Any], Any], size: int) -> None:
    @fresh
    def total(values: np.ndarray) -> float:
        found = 0.0
        for value in values:
            found += value
        return found

    values = np.random.default_rng(0).normal(size=size)
    assert total(values) == pytest.approx(values.sum(), abs=1e-12)
