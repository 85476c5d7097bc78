"""Gates of `make check` that ruff does not have: modules, commit subjects, what kernels and we of numba may use.

At most 10 arguments and fewer than 4 nested blocks in a function are rules of ruff (pyproject.toml). Run it as
`python tests/gates.py`: it prints each violation and exits with 1 if there is one.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

ROOT = Path(__file__).resolve().parents[1]
MOST_LINES = 300
EXEMPT = {
    "messages.py": "all messages of the house in one place; half of it is docstrings",
    "errors.py": "all errors of the house in one place, with the tree of them at its top",
}
"""Modules and folders of src/taxelflow that may be longer, and why."""

MOST_CHARACTERS = 72
SINCE = "2026-11-22T13:10:00Z"
"""When the redesign began: subjects of older commits are not checked."""

KERNELS = {"kernel", "exact_kernel", "long_kernel", "routine", "inlined", "lean_kernel", "vector_kernel"}
"""Decorators of `taxelflow.runtime.compiling`."""
DEAR = {
    "linalg",
    "median",
    "percentile",
    "quantile",
    "sort",
    "argsort",
    "dot",
    "outer",
    "mean",
    "std",
    "var",
    "sum",
} | {
    *(
        "any",
        "all",
        "max",
        "min",
        "argmax",
        "argmin",
        "amax",
        "amin",
        "cumsum",
        "diff",
        "where",
        "concatenate",
        "stack",
    ),
    *("reshape", "ravel", "flatten", "transpose", "ascontiguousarray", "searchsorted", "interp", "unique"),
}
"""Functions and methods of arrays of which numba compiles the first use in 0.1 to 1.8 s; a loop takes 0.02 s."""
MAY = {
    "condition/filters.py": {"median": "a filter that the user asks for; by rank it would be slow for 99 scans"},
    "estimation/scan_matching/interpolant.py": {"reshape": "a view of contiguous coefficients as one row"},
}
"""Dear constructs that kernels of a module of src/taxelflow may use, and why."""


def long_modules(package: Path, exempt: Mapping[str, str] = EXEMPT) -> list[str]:
    """Modules of a package with more than 300 lines, and exemptions that none needs."""
    lines = {
        path.relative_to(package).as_posix(): len(path.read_text(encoding="utf-8").splitlines())
        for path in sorted(package.rglob("*.py"))
    }
    long = {name: count for name, count in lines.items() if count > MOST_LINES}
    covered = {part: [name for name in long if name == part or name.startswith(f"{part}/")] for part in exempt}
    excused = {name for names in covered.values() for name in names}
    return [
        *(f"{name} has {count} lines, at most {MOST_LINES}" for name, count in long.items() if name not in excused),
        *(
            f"{part} is exempt but has no module over {MOST_LINES} lines"
            for part, names in covered.items()
            if not names
        ),
    ]


def dear_constructs(package: Path, may: Mapping[str, Mapping[str, str]] = MAY) -> list[str]:
    """Constructs in kernels of a package that take long to compile, and exemptions that none needs."""
    found, used = [], set()
    for path in sorted(package.rglob("*.py")):
        name = path.relative_to(package).as_posix()
        for line, construct in _dear_in(ast.parse(path.read_text(encoding="utf-8"))):
            if construct in may.get(name, {}):
                used.add((name, construct))
            else:
                found.append(f"{name}:{line}: {construct} in a kernel takes long to compile; write a loop")
    for name, constructs in may.items():
        found += [f"{name} may use {one} but does not" for one in constructs if (name, one) not in used]
    return found


def _dear_in(module: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and name of each dear construct in the kernels of a module."""
    for function in ast.walk(module):
        if not isinstance(function, ast.FunctionDef):
            continue
        if not any(isinstance(one, ast.Name) and one.id in KERNELS for one in function.decorator_list):
            continue
        for node in ast.walk(function):
            if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
                yield node.lineno, "@"
            elif isinstance(node, ast.Attribute) and node.attr in DEAR and not _is_field(node, function):
                yield node.lineno, node.attr
            elif isinstance(node, ast.Assign | ast.AugAssign) and _fills_slice(node):
                yield node.lineno, "a slice filled from an array"


def _is_field(node: ast.Attribute, function: ast.FunctionDef) -> bool:
    """Whether an attribute is a record's field, not a function: it is not called."""
    called = (one.func for one in ast.walk(function) if isinstance(one, ast.Call))
    return node.attr != "linalg" and all(one is not node for one in called)


def _fills_slice(node: ast.Assign | ast.AugAssign) -> bool:
    """Whether an assignment fills a slice from more than one number; a name counts as an array."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    sliced = any(
        isinstance(one, ast.Subscript) and any(isinstance(part, ast.Slice) for part in ast.walk(one.slice))
        for target in targets
        for one in ast.walk(target)
    )
    values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
    return sliced and (
        isinstance(node, ast.AugAssign) or not all(isinstance(one, ast.Constant | ast.UnaryOp) for one in values)
    )


def private_names(folder: Path) -> list[str]:
    """Private names of numba that modules below a folder import, or give as options."""
    found = []
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            found += [f"{path.name}:{node.lineno}: {name} is private to numba" for name in _private_in(node)]  # type: ignore[attr-defined]
    return found


def _private_in(node: ast.AST) -> list[str]:
    if isinstance(node, ast.ImportFrom):
        names = [f"{node.module}.{one.name}" for one in node.names]
    elif isinstance(node, ast.Import):
        names = [one.name for one in node.names]
    elif isinstance(node, ast.keyword):
        return ["_nrt"] if node.arg == "_nrt" else []
    else:
        return []
    return [name for name in names if name.startswith("numba.") and "._" in name]


def long_subjects(subjects: Iterable[str]) -> list[str]:
    """Commits whose subject has more than 72 characters, each given as `HASH SUBJECT`."""
    return [
        f"commit {line}: {len(line.partition(' ')[2])} characters, at most {MOST_CHARACTERS}"
        for line in subjects
        if len(line.partition(" ")[2]) > MOST_CHARACTERS
    ]


def recent_subjects(root: Path) -> list[str]:
    """`HASH SUBJECT` of commits since SINCE; none without git, in a shallow clone, or in another project's checkout."""
    try:
        if Path(_git(root, "rev-parse", "--show-toplevel").strip()).resolve() != root.resolve():
            return []
        if _git(root, "rev-parse", "--is-shallow-repository").strip() == "true":
            return []
        return _git(root, "log", f"--since={SINCE}", "--format=%h %s").splitlines()
    except (OSError, subprocess.CalledProcessError):
        return []


def _git(root: Path, *arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=root, check=True, capture_output=True, text=True).stdout


def main() -> int:
    """Print what violates a gate."""
    package = ROOT / "src" / "taxelflow"
    violations = long_modules(package) + dear_constructs(package) + long_subjects(recent_subjects(ROOT))
    violations += private_names(package) + private_names(ROOT / "tests")
    for violation in violations:
        print(violation, file=sys.stderr)
    return bool(violations)


if __name__ == "__main__":
    raise SystemExit(main())
