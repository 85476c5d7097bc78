"""`make golden` and `make golden-update`: compare results with the golden archive, or write it."""

from __future__ import annotations

import argparse
import sys

from golden.archive import ARCHIVE, compare, load, save
from golden.runs import run_all


def main(arguments: list[str] | None = None) -> int:
    """Exit code: 0 no difference, 1 a difference, 2 no archive."""
    parser = argparse.ArgumentParser(prog="golden", description=__doc__)
    parser.add_argument("what", choices=("compare", "update"))
    parser.add_argument("--only", default="", help="Compare runs whose name contains this text.")
    parser.add_argument("--rtol", type=float, help="Relative tolerance of numbers; 0 compares bit for bit.")
    parser.add_argument("--processes", type=int, default=2, help="Recordings to work on at a time.")
    options = parser.parse_args(arguments)
    if options.only and options.what == "update":
        parser.error(f"update writes all runs (--only {options.only} is for compare)")
    if options.what == "compare" and not ARCHIVE.is_file():
        print(f"no golden archive at {ARCHIVE}: run make golden-update", file=sys.stderr)
        return 2
    found, skipped = run_all(options.only, options.processes)
    for reason in skipped:
        print(f"skipped: {reason}")
    if options.what == "update":
        save(found)
        print(f"{len(found)} runs in {ARCHIVE} ({ARCHIVE.stat().st_size / 1e3:.0f} kB)")
        return 0
    return compare(load(), found, options.rtol)


if __name__ == "__main__":
    sys.exit(main())
