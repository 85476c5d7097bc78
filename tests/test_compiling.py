from __future__ import annotations

import abc
import gc
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numba
import numpy as np
import pytest
from numba.core import event
from numba.extending import is_jitted

import taxelflow
from taxelflow.runtime import compiling, lowering, pipeline
from taxelflow.runtime.compiling import kernel, lean_kernel, long_kernel, routine

if TYPE_CHECKING:
    from collections.abc import Callable

MODULE = """
from taxelflow.runtime.compiling import kernel

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
from taxelflow.runtime.compiling import announced
if {inside}:
    with announced():
        print(twice(1.5), thrice(1.5), twice(1), thrice(1))
else:
    print(twice(1.5), thrice(1.5), twice(1), thrice(1))
with announced():
    print(twice(2.5))
"""


ARRAYS = """
from numba.core.runtime import rtsys
from taxelflow.runtime.compiling import kernel, routine

@routine
def ones(count):
    made = np.empty(count)
    for k in range(count):
        made[k] = 1.0
    return made

@kernel
def total(count):
    made, found = ones(count), 0.0
    for k in range(count):
        found += made[k]
    made = ones(2)
    return found + made[0]

print(total(3))
before = rtsys.get_allocation_stats()
print(total(1000))
after = rtsys.get_allocation_stats()
print(after.alloc - before.alloc, after.free - before.free)
"""
ITERATED = """
from numba.core.runtime import rtsys
from taxelflow.runtime.compiling import kernel, routine

@routine
def total(arrays):
    found = 0.0
    for one in arrays:
        for row in one:
            found += row[-1]
        view = one[1:]
        found += view[0, 0]
    return found

@kernel
def filled(count):
    first, second = np.ones((count, 2)), np.ones((count, 3))
    found = 0.0
    for _ in range(3):
        for k, one in enumerate((first, second)):
            found += one[0, 0] + k
        found += total((first, second))
    third = np.zeros((count, 2))  # has the room of an array that was freed too early
    fourth = np.zeros((count, 3))
    return found + first[0, 1] + second[-1, -1] + third[0, 0] + fourth[0, 0]

print(filled(4))
before = rtsys.get_allocation_stats()
print(filled(4))
after = rtsys.get_allocation_stats()
print(after.alloc - before.alloc, after.free - before.free)
"""
LEAN = """
from numba.core.runtime import rtsys
from taxelflow.runtime.compiling import kernel, lean_kernel

@lean_kernel
def total(pair):
    one, other = pair
    again = one[1:]
    return one[0] + again[0] + again[1] + other[0]

@kernel
def filled(count):
    made = np.empty(count)
    for k in range(count):
        made[k] = k
    return total((made, made[3:]))

print(filled(4))
before = rtsys.get_allocation_stats()
print(filled(4))
after = rtsys.get_allocation_stats()
print(after.alloc - before.alloc, after.free - before.free)
"""
OTHER = """
import sys
import numba
numba.__version__ = "0.99.0"
from taxelflow.runtime.compiling import kernel, lean_kernel, routine

@lean_kernel
def total(values):
    found = 0.0
    for value in values:
        found += value
    return found

@routine
def square(x):
    return x * x

@kernel
def eighth(x):
    return square(square(square(x)))

@kernel
def all_of(values):
    return total(values)

print(all_of(np.array([1.0, 2.0, 3.0])))
print(eighth(2.0))
print("pipeline_class" in eighth.targetoptions, "taxelflow.runtime.pipeline" in sys.modules)
"""


def printed(folder: Path, program: str, **environment: str) -> str:
    """What a program with kernels prints in a fresh process, whose kernels are compiled there."""
    (folder / "program.py").write_text("import numpy as np\n" + program)
    own = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), **environment}
    command = [sys.executable, "-W", "error", "program.py"]
    done = subprocess.run(command, cwd=folder, env=own, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], Any]:
    """`kernel`, but compiled as it says now, not loaded as it said when a test was run before."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    return kernel


def started(folder: Path, *, inside: bool = True, **environment: str) -> subprocess.Popen[str]:
    """A fresh process that calls two kernels."""
    (folder / "kernels.py").write_text(MODULE)
    paths = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    own = {"PYTHONPATH": os.pathsep.join(paths), "NUMBA_CACHE_DIR": str(folder / "cache")}
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", PROGRAM.format(inside=inside)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={**os.environ, **own, **environment},
    )


def lines_of(process: subprocess.Popen[str]) -> list[str]:
    """Lines on its stderr, once it has printed what it should."""
    out, lines = process.communicate()
    assert process.returncode == 0, lines
    assert out == "3.0 4.5 2.0 3.0\n5.0\n"
    return lines.splitlines()


def said(folder: Path, *, inside: bool = True, **environment: str) -> list[str]:
    """Lines on stderr of a fresh process that calls two kernels."""
    return lines_of(started(folder, inside=inside, **environment))


@pytest.mark.long
def test_the_first_compile_is_announced_once_and_a_cached_load_stays_silent(tmp_path: Path) -> None:
    (line,) = said(tmp_path)
    logger, level, message = line.split("|")
    assert (logger, level) == ("taxelflow", "WARNING")
    assert "compiling" in message
    (folder,) = (tmp_path / "cache").iterdir()
    assert folder.name == f"kernels-{compiling.hash_of('kernels')[:16]}"
    assert list(folder.rglob("*.nbi"))
    assert said(tmp_path) == []


@pytest.mark.long
def test_outside_of_the_context_nothing_is_announced(tmp_path: Path) -> None:
    assert said(tmp_path, inside=False) == []


@pytest.mark.long
def test_two_first_runs_at_once_do_no_harm(tmp_path: Path) -> None:
    both = [started(tmp_path), started(tmp_path)]
    lines = [line for process in both for line in lines_of(process)]
    assert len(lines) in (1, 2)  # one that starts late finds what the other compiled
    assert all("compiling" in line for line in lines)
    assert said(tmp_path) == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("runs", "environment"),
    [
        (2, {"NUMBA_CACHE_DIR": "{taken}"}),
        (1, {"NUMBA_CACHE_DIR": "", "HOME": "{taken}", "XDG_CACHE_HOME": "{taken}/cache"}),
    ],
)
def test_without_a_folder_that_can_be_written_each_run_compiles_and_reports_it(
    tmp_path: Path, runs: int, environment: dict[str, str]
) -> None:
    (tmp_path / "taken").write_text("a file, where a folder is needed")
    own = {name: text.format(taken=tmp_path / "taken") for name, text in environment.items()}
    for _ in range(runs):
        (line,) = said(tmp_path, **own)
        assert line.endswith(
            "as in every run: there is no folder to cache them; set NUMBA_CACHE_DIR to a folder that can be written"
        )


def test_while_a_kernel_compiles_a_watched_terminal_shows_a_bar(
    fresh: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("FORCE_COLOR", "1")

    @fresh
    def half(x: float) -> float:
        return 0.5 * x

    assert gc.isenabled()
    with compiling.announced():
        assert half(3.0) == 1.5
    assert gc.isenabled()
    assert "compiling" in capsys.readouterr().err


def test_a_kernel_is_compiled_without_python_and_keeps_its_lock(fresh: Callable[[Any], Any]) -> None:
    @fresh
    def total(values: np.ndarray) -> float:
        found = 0.0
        for value in values:
            found += value
        return found

    assert is_jitted(total)
    assert total.targetoptions["nopython"]
    assert not total.targetoptions["nogil"]
    assert cast("Any", long_kernel(total.py_func)).targetoptions["nogil"]


def test_machine_code_is_emitted_for_the_kernel_and_for_none_of_its_routines(fresh: Callable[[Any], Any]) -> None:
    @routine
    def square(x: float) -> float:
        return x * x

    @routine
    def fourth(x: float) -> float:
        return square(x) * square(x)

    @fresh
    def eighth(x: float) -> float:
        return fourth(x) * fourth(x)

    with event.install_recorder("numba:compile") as recorder:
        assert eighth(2.0) == 256.0
    emitted = {}
    for _, one in recorder.buffer:
        for compiled in one.data["dispatcher"].overloads.values():
            pointer = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
            emitted[one.data["dispatcher"].py_func.__name__] = pointer != 0
    assert emitted == {"square": False, "fourth": False, "eighth": True}
    assert fourth(2.0) == 16.0


@pytest.mark.long
def test_an_array_that_a_kernel_or_a_routine_makes_is_freed(tmp_path: Path) -> None:
    assert printed(tmp_path, ARRAYS, NUMBA_NRT_STATS="1") == "4.0\n1001.0\n2 2\n"


@pytest.mark.long
def test_arrays_that_are_iterated_over_are_freed_once(tmp_path: Path) -> None:
    assert printed(tmp_path, ITERATED, NUMBA_NRT_STATS="1") == "41.0\n41.0\n4 4\n"


@pytest.mark.long
def test_arrays_come_and_go_through_a_lean_routine_without_a_leak(tmp_path: Path) -> None:
    assert printed(tmp_path, LEAN, NUMBA_NRT_STATS="1") == "6.0\n6.0\n1 1\n"


def test_a_lean_routine_cannot_make_an_array(fresh: Callable[[Any], Any]) -> None:
    @lean_kernel
    def made(count: int) -> float:
        return float(np.empty(count)[0])

    @fresh
    def total(count: int) -> float:
        return made(count)

    with pytest.raises(numba.core.errors.NumbaError, match="Only accept returning of array passed"):
        total(3)


def test_nothing_that_is_private_to_numba_is_overridden() -> None:
    houses = (pipeline, lowering)
    ours = [
        one for module in houses for one in vars(module).values() if getattr(one, "__module__", "") == module.__name__
    ]
    ours = [one for one in ours if isinstance(one, type)]
    assert len(ours) > 5
    of_python = set(vars(abc.ABC))
    for one in ours:
        numbas = [base for base in one.__mro__ if base.__module__.startswith("numba.")]
        private = [name for name in vars(one) if re.fullmatch("_[a-z].*", name)]
        overridden = {name for name in private for base in numbas if name in vars(base)}
        assert overridden - of_python <= {"_name"}, one  # of a pass: documented


@pytest.mark.long
def test_another_release_of_numba_compiles_by_its_own_pipeline(tmp_path: Path) -> None:
    """The version is changed before our modules are imported: no release but the pinned one is at hand."""
    assert printed(tmp_path, OTHER) == "6.0\n256.0\nFalse False\n"


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


def test_a_kernel_is_recompiled_when_what_it_imports_has_changed(
    fresh: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def misses(sources: str) -> int:
        monkeypatch.setattr(compiling, "hash_of", lambda _module: sources)

        @fresh
        def twice(x: float) -> float:
            return 2.0 * x

        assert twice(1.5) == 3.0
        return sum(twice.stats.cache_misses.values())

    assert [misses(sources) for sources in ("old", "old", "new", "new")] == [1, 0, 1, 0]


def test_a_hash_covers_a_module_and_all_that_it_imports(tmp_path: Path) -> None:
    package = tmp_path / "taxelflow"
    (package / "stage").mkdir(parents=True)
    sources = {
        "stage/kernels.py": "from taxelflow.stage import shared as also\n"
        "from taxelflow.messages import (\n    OK,\n)\n",
        "stage/shared.py": "from taxelflow.numbers import TWO\n",
        "numbers.py": "TWO = 2\n",
        "messages.py": "OK = 1\n",
        "stage/other.py": "X = 1\n",
    }
    for name, text in sources.items():
        (package / name).write_text(text)
    before = compiling.hash_of("taxelflow.stage.kernels", package)
    for name, text in sources.items():
        (package / name).write_text(text + "# changed\n")
        compiling.hash_of.cache_clear()
        after = compiling.hash_of("taxelflow.stage.kernels", package)
        assert (after == before) == (name == "stage/other.py"), name
        (package / name).write_text(text)


def test_the_hash_of_a_kernel_of_the_package_holds_its_own_source() -> None:
    names = {file.name for file in compiling.sources_of("taxelflow.numerics.banded")}
    assert {"banded.py", "compiling.py", "pipeline.py"} <= names


@pytest.mark.parametrize("stage", ["condition", "contacts", "estimation", "fusion", "slip"])
def test_no_kernel_depends_on_the_sources_of_another_stage(stage: str) -> None:
    stages = {"condition", "contacts", "estimation", "fusion", "slip"} - {stage}
    package = Path(taxelflow.__file__).parent
    paths = list((package / stage).rglob("*.py"))
    assert paths
    for path in paths:
        module = "taxelflow." + ".".join(path.relative_to(package).with_suffix("").parts)
        sources = compiling.sources_of(module)
        assert path in sources
        others = {file for file in sources if file.relative_to(package).parts[0] in stages}
        assert not others, module


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
