"""The runs of the golden archive: scenarios of the rig and real recordings, by every method, as batch and as stream."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import taxelflow

METHODS = ("lnorm", "convolution", "template", "registration", "sum", "principal_axis")
MODES = ("batch", "stream")
SCENARIOS: dict[str, tuple[str, ...]] = {
    "stroke": (),
    "slide-and-turn": (),
    "bar-on-grid": (),
    "texture-on-grid": (),
    "bulb-pull": (),
    "slide-and-turn-over-hand": (),
    "stick-slip": (),
    "stick-slip-feet": (),
    "feet-lift": (),
    "two-contacts": (),
    "press": (),
    "tilt": (),
}
"""Names of scenarios, with options of `taxelflow simulate`."""
SEED = 3
SEPARATED = {"two-contacts": 2}
REAL: dict[str, dict[str, Any]] = {
    "sdh-dsa/tennisball.dsa": {},
    "sdh-dsa/slip_and_rotation_teapot_handle.dsa": {},
    "sdh-bags/slip_up.bag": {},
}
"""Real recordings, by path under the data folder, with what `taxelflow.read` needs. Skipped where they are absent."""
KEPT_SCANS = 10
"""Scans of each run whose numbers are in the archive; the digest holds all scans to the bit."""

Run = dict[str, "np.ndarray"]


def data_folder() -> Path:
    """Where the real recordings are looked for."""
    return Path(os.environ.get("TAXELFLOW_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data")


def run_all(only: str, processes: int) -> tuple[dict[str, Run], list[str]]:
    """All runs whose name contains `only`, by name, and what was skipped and why."""
    jobs = [
        (f"{name}/{method}/{mode}", name, method, mode)
        for name in (*SCENARIOS, *REAL)
        for method in METHODS
        for mode in MODES
    ]
    jobs = [job for job in jobs if only in job[0]]
    absent = [name for name in REAL if not (data_folder() / name).is_file()]
    skipped = [f"{name} is not in {data_folder()}" for name in absent]
    jobs = [job for job in jobs if job[1] not in absent]
    with TemporaryDirectory() as folder, ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        for name in {job[1] for job in jobs} & SCENARIOS.keys():
            simulated(name, Path(folder))
        futures = {job[0]: pool.submit(run, *job[1:], folder) for job in jobs}
        return {name: future.result() for name, future in futures.items()}, skipped


def simulated(name: str, folder: Path) -> None:
    """Write a scenario's recording into a folder."""
    from taxelflow.cli import main

    assert main(["simulate", name, "--seed", str(SEED), *SCENARIOS[name], "--out", str(folder / f"{name}.npz")]) == 0


def run(name: str, method: str, mode: Any, folder: str) -> Run:
    """One recording by one method: a digest of each field's bytes, and the numbers of a few scans."""
    import taxelflow

    if name in REAL:
        recording = taxelflow.read(data_folder() / name, **REAL[name])
    else:
        recording = taxelflow.read(Path(folder) / f"{name}.npz")
    result = taxelflow.estimate(recording, method, mode=mode, contacts=SEPARATED.get(name))
    return digested(result)


def digested(result: taxelflow.Result) -> Run:
    """Arrays by field: `digest:` of all scans, `kept:` of a few."""
    held: Run = {}
    every = max(1, len(result.slips) // KEPT_SCANS)
    for stage in ("slips", "motions", "contacts"):
        message = getattr(result, stage)
        for field in fields(message):
            _hold(held, f"{stage}.{field.name}", np.asarray(getattr(message, field.name)), every)
    _hold(held, "slipping", result.slipping, every)
    for number in ("t_s", "onset_s", "direction_rad", "speed_m_s", "turn_rad_s"):
        _hold(held, f"events.{number}", np.array([getattr(event, number) for event in result.events]), 1)
    what = " ".join(f"{event.pad}:{event.event}" for event in result.events)
    held["digest:events"] = np.array(sha256(what.encode()).hexdigest()[:16])
    held["count:events"] = np.array(len(result.events))
    for number, pattern in enumerate(result.patterns):
        for field in ("x_m", "y_m", "pressure", "std", "dead"):
            values = np.asarray(getattr(pattern, field))
            _hold(held, f"patterns[{number}].{field}", values.ravel(), max(1, values.size // KEPT_SCANS))
    return held


def _hold(held: Run, name: str, values: np.ndarray, every: int) -> None:
    if np.isnan(values).all() if values.dtype.kind == "f" else not values.any():
        held[f"digest:{name}"] = np.array(f"{'NaN' if values.dtype.kind == 'f' else 'zero'} {values.shape}")
        return
    held[f"digest:{name}"] = np.array(sha256(np.ascontiguousarray(values).tobytes()).hexdigest()[:16])
    held[f"kept:{name}"] = values[::every]
