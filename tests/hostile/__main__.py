"""`make hostile`: what each hostile file costs, and the message that refuses it. `make fuzz` adds changed files."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from hostile.files import MAKERS
from hostile.fuzz import fuzz
from hostile.measure import MOST_MB, MOST_S, measured


def main(arguments: list[str] | None = None) -> int:
    """Exit code: 0 if every file was refused or read within the limits, 1 otherwise."""
    parser = argparse.ArgumentParser(prog="hostile", description=__doc__)
    parser.add_argument("--only", default="", help="Files whose name contains this text.")
    parser.add_argument("--fuzz", type=float, default=0.0, help="Seconds to change whole files in their structure.")
    parser.add_argument("--seed", type=int, default=0, help="Seed of the changes.")
    options = parser.parse_args(arguments)
    broken = 0
    print(f"{'file':45} {'bytes':>9} {'MB':>5} {'CPU s':>5} exit message")
    with tempfile.TemporaryDirectory() as folder:
        for name in (name for name in MAKERS if options.only in name):
            cost = measured(name, Path(folder))
            broken += not cost.within
            mark = "" if cost.within else "BEYOND THE LIMITS: "
            said = cost.message.replace(f"{folder}/", "").replace("\n", " | ")
            print(
                f"{name:45} {cost.size:9} {cost.peak_mb:5.0f} {cost.cpu_s:5.1f} {cost.exit!s:>4} {mark}{said}",
                flush=True,
            )
        print(f"limits: {MOST_MB} MB, {MOST_S} s; {broken} files beyond them")
        if options.fuzz:
            broken += fuzz(Path(folder), options.fuzz, options.seed)
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
