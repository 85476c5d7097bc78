"""`make bench-start`: CPU time of the first estimate on the demo's stroke from an empty kernel cache, and of the next.

With AGAINST=REF the sources of another commit are measured in the same run, for the load of the machine counts, too.
Times are user and system time of the process and its children.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
CLI = "import sys, taxelflow; from taxelflow.cli import main; sys.exit(main(sys.argv[1:]))"


def cpu_s(source: Path, cache: Path, *arguments: str) -> float:
    """CPU seconds of one `taxelflow` command, run by the sources in a folder."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "PYTHONPATH": str(source), "NUMBA_CACHE_DIR": str(cache)}
    subprocess.run([sys.executable, "-c", CLI, *arguments], check=True, capture_output=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def sources_of(ref: str, folder: Path) -> Path:
    """The package's sources at a commit, unpacked into a folder."""
    archive = subprocess.run(["git", "archive", ref, "src"], cwd=ROOT, check=True, capture_output=True).stdout
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive, check=True)
    return folder / "src"


def main() -> None:
    """Print a table: sources, method, CPU seconds of a first and of a second run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", default="", help="A commit to measure beside this checkout.")
    parser.add_argument("--methods", nargs="+", default=["convolution", "template"])
    options = parser.parse_args()
    print(f"{'sources':<16}{'method':<16}{'first, s':>10}{'again, s':>10}")
    with TemporaryDirectory() as name:
        folder = Path(name)
        stroke = str(folder / "stroke.npz")
        cpu_s(ROOT / "src", folder / "cache", "simulate", "stroke", "--out", stroke)
        compared = {options.against: sources_of(options.against, folder)} if options.against else {}
        for method in options.methods:
            for sources, source in {**compared, "this checkout": ROOT / "src"}.items():
                cache = folder / f"{sources}-{method}".replace("/", "-")
                command = ("estimate", stroke, "--method", method, "--out", str(folder / "result"))
                first, again = cpu_s(source, cache, *command), cpu_s(source, cache, *command)
                print(f"{sources:<16}{method:<16}{first:>10.1f}{again:>10.1f}", flush=True)


if __name__ == "__main__":
    main()
