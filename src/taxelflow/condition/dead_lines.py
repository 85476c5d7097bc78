"""Detection of dead rows and columns of a grid: lines that stay silent between loaded ones while the load moves over.

A matrix of crossing electrodes that loses a wire loses all of its taxels. Each has silent neighbours in its line then,
so that no taxel stands out by itself (`health`). A gap of the object between two lines would move with the load.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.health import EVIDENCE, Finding, resting_level

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout


def find_dead_lines(windows: Floats, noise: Floats, masked: Bools, layout: Layout) -> dict[int, Finding]:
    """Findings by taxel, for each one of a dead row or column; at most one a taxel.

    windows: (windows, scans, taxels) in SI, NaN where missing. noise, masked: (taxels,). Masked taxels are not judged.
    """
    found: dict[int, Finding] = {}
    flat = windows.reshape(-1, windows.shape[2])
    for pad in np.flatnonzero(~np.asarray(layout.tables[: layout.pad_count], dtype=np.bool_)).tolist():
        own = layout.of_pad(pad)
        readings = np.where(masked[own], np.nan, flat[:, own])
        known = np.isfinite(readings)
        if np.count_nonzero(known.sum(axis=0) >= EVIDENCE.min_scans) <= EVIDENCE.min_neighbours:
            continue
        load = readings - resting_level(readings, np.min(readings, axis=0, initial=np.inf, where=known))
        least = EVIDENCE.load_sigmas * float(np.median(noise[own][known.any(axis=0)]))
        load = load[(load > least).any(axis=1)]
        image = np.full((len(load), *layout.shapes[pad]), np.nan)
        image[:, layout.row[own], layout.col[own]] = load
        taxels = np.full(layout.shapes[pad], -1)
        taxels[layout.row[own], layout.col[own]] = np.arange(own.start, own.stop)
        for finding in (*_dead(image, least, taxels), *_dead(image.swapaxes(1, 2), least, taxels.T)):
            found.setdefault(finding.taxel, finding)
    return found


def _dead(image: Floats, least: float, taxels: NDArray[np.int64]) -> Iterator[Finding]:
    """Taxels of lines that are dead. image: (scans, lines, places), loads, NaN where unknown. least: of a load.

    taxels: (lines, places), their numbers; -1 where there is none.
    """
    loaded = np.where(image > least, image, 0.0)
    profile = loaded.sum(axis=2)
    for line in range(1, len(taxels) - 1):
        between = np.minimum(image[:, line - 1], image[:, line + 1])
        asked = (between > least) & np.isfinite(image[:, line])
        scans = np.flatnonzero(asked.any(axis=1))
        if len(scans) < EVIDENCE.min_loaded_scans or asked.any(axis=0).sum() < EVIDENCE.min_neighbours:
            continue
        silent = image[:, line] * EVIDENCE.gain_ratio < between
        centre = profile[scans] @ np.arange(len(taxels)) / profile[scans].sum(axis=1)
        if silent[asked].mean() < EVIDENCE.min_gain_share or np.ptp(centre) < EVIDENCE.min_travel:
            continue
        factor = float(np.median(image[:, line][asked] / between[asked]))
        for taxel in taxels[line][taxels[line] >= 0].tolist():
            yield Finding(taxel, "line", factor, factor, len(scans))
