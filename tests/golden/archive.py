"""The golden archive on disk, and the comparison with it."""

from __future__ import annotations

import io
import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from golden.deviations import NEAR, UNDECIDED, first_deviation, is_plain, iterates

if TYPE_CHECKING:
    from golden.runs import Run

ARCHIVE = Path(__file__).with_name("golden.npz")
ELSEWHERE = 1e-9
"""Relative tolerance on a machine other than the archive's, of what is computed in a fixed number of steps."""


def machine() -> dict[str, str]:
    """What must be the same for results to be equal to the bit; the processor that kernels are compiled for."""
    from llvmlite import binding
    from numba import config

    features = ",".join(sorted(name for name, has in binding.get_host_cpu_features().items() if has))
    libraries = {name: version(name) for name in ("numpy", "scipy", "numba", "llvmlite")}
    return {
        "cpu": config.CPU_NAME or binding.get_host_cpu_name(),
        "features": features if config.CPU_FEATURES is None else config.CPU_FEATURES,
        "python": platform.python_version(),
        **libraries,
    }


def save(runs: dict[str, Run], path: Path = ARCHIVE) -> None:
    """Write the archive: one array of names and shapes, one of digests, and all kept numbers end to end by type."""
    index: dict[str, dict[str, list[object]]] = {}
    held: dict[str, list[np.ndarray]] = {}
    for name, run in sorted(runs.items()):
        entries = index.setdefault(name, {})
        for field, values in sorted(run.items()):
            if field.startswith("kept:"):
                kind = values.dtype.str
                entries[field] = [kind, list(values.shape)]
                held.setdefault(kind, []).append(values.ravel())
            else:
                entries[field] = [values.item()]
    text = json.dumps({"machine": machine(), "runs": index}, separators=(",", ":"))
    arrays = {f"kept {kind}": np.concatenate(parts) for kind, parts in held.items()}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, index=np.array(text), **arrays)
    path.write_bytes(buffer.getvalue())


def load(path: Path = ARCHIVE) -> tuple[dict[str, str], dict[str, Run]]:
    """The machine that wrote the archive, and its runs."""
    with np.load(path, allow_pickle=False) as file:
        index = json.loads(file["index"].item())
        held = {name.removeprefix("kept "): file[name] for name in file.files if name != "index"}
    used = dict.fromkeys(held, 0)
    runs: dict[str, Run] = {}
    for name, entries in index["runs"].items():
        run = runs.setdefault(name, {})
        for field, entry in entries.items():
            if not field.startswith("kept:"):
                run[field] = np.array(entry[0])
                continue
            kind, shape = entry
            size = int(np.prod(shape))
            run[field] = held[kind][used[kind] : used[kind] + size].reshape(shape)
            used[kind] += size
    return index["machine"], runs


def compare(golden: tuple[dict[str, str], dict[str, Run]], found: dict[str, Run], rtol: float | None = None) -> int:
    """Print the first difference of each run that differs; 1 if there is one.

    rtol: relative to the largest number of the field; None stands for 0, bit for bit, on the machine that wrote the
    archive. On any other it stands for `ELSEWHERE`, and for the tolerance of `deviations` where a method iterates.
    """
    wrote, runs = golden
    changed = [f"{what} {was} -> {now}" for what, was in wrote.items() if (now := machine().get(what)) != was]
    elsewhere = rtol is None and bool(changed)
    compared, how = found, f"within {rtol:g}" if rtol else "to the bit"
    if elsewhere:
        print(f"another machine than the archive's: {'; '.join(changed)}")
        print(
            f"not compared, as rounding decides between fits: {', '.join(sorted(UNDECIDED & found.keys())) or 'none'}"
        )
        compared = {name: run for name, run in found.items() if name not in UNDECIDED}
        how = f"within {ELSEWHERE:g}, or {NEAR:g} standard deviations"
    bad = 0
    for name, run in compared.items():
        if name not in runs:
            message = "not in the archive"
        elif elsewhere:
            message = _difference_elsewhere(name, runs[name], run)
        else:
            message = first_difference(runs[name], run, rtol or 0.0)
        if message:
            bad += 1
            print(f"{name}: {message}")
    print(f"{len(compared) - bad} of {len(compared)} runs are equal {how}")
    return 1 if bad or not compared else 0


def _difference_elsewhere(name: str, golden: Run, run: Run) -> str:
    """The first difference of a run on another machine, see `deviations`; empty if there is none."""
    plain = set() if iterates(name) else {field for field in golden.keys() | run.keys() if is_plain(field)}
    was, now = ({field: of[field] for field in of.keys() & plain} for of in (golden, run))
    return first_difference(was, now, ELSEWHERE) or first_deviation(golden, run)


def first_difference(golden: Run, run: Run, rtol: float) -> str:
    """The first field that differs, in words, with its place and both values; empty if there is none."""
    for field in sorted(golden.keys() | run.keys(), key=lambda field: field.partition(":")[::-1]):
        name = field.partition(":")[2]
        if (field in golden) != (field in run):
            return f"{name} is {'missing' if field in golden else 'new, or no longer empty'}"
        was, now = golden[field], run[field]
        if field.startswith("kept:"):
            if message := _differs(name, was, now, rtol):
                return message
        elif was != now and (rtol == 0.0 or field.startswith("count:")) and f"kept:{name}" not in golden:
            return f"{name} was {was.item()}, is {now.item()}"
    for field in golden:
        if field.startswith("digest:") and rtol == 0.0 and golden[field] != run[field]:
            return f"{field.partition(':')[2]} differs, but not in the scans whose numbers the archive holds"
    return ""


def _differs(name: str, was: np.ndarray, now: np.ndarray, rtol: float) -> str:
    if was.shape != now.shape:
        return f"{name} has shape {now.shape}, had {was.shape} (of the scans that are kept)"
    if was.dtype.kind != "f" or rtol == 0.0:
        same = (was == now) | (np.isnan(was) & np.isnan(now) if was.dtype.kind == "f" else False)
    else:
        finite = np.abs(was[np.isfinite(was)])
        same = np.isclose(now, was, rtol=0.0, atol=rtol * (finite.max() if finite.size else 0.0), equal_nan=True)
    places = np.argwhere(~same)
    if not len(places):
        return ""
    place = tuple(places[0].tolist())
    return f"{name}{list(place)} (kept scans) was {was[place]!r}, is {now[place]!r}; {len(places)} of {was.size} differ"
