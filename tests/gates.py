"""Gates of `make check` that ruff does not have: length of modules and of commit subjects.

At most 10 arguments and fewer than 4 nested blocks in a function are rules of ruff (pyproject.toml). Run it as
`python tests/gates.py`: it prints each violation and exits with 1 if there is one.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

ROOT = Path(__file__).resolve().parents[1]
MOST_LINES = 300
EXEMPT = {
    "messages.py": "all messages of the house in one place; half of it is docstrings",
}
"""Modules and folders of src/taxelflow that may be longer, and why."""

MOST_CHARACTERS = 72
SINCE = "2026-11-22T13:10:00Z"
"""When the redesign began: subjects of older commits are not checked."""


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
    violations = long_modules(ROOT / "src" / "taxelflow") + long_subjects(recent_subjects(ROOT))
    for violation in violations:
        print(violation, file=sys.stderr)
    return bool(violations)


if __name__ == "__main__":
    raise SystemExit(main())
