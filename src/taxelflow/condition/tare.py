"""Offset of idle taxels, estimated without mistaking a steady contact for an offset.

A pad is idle where its sum is lowest, and only if the readings there stay, are small (all taxels below a share of the
full scale, if one is declared) and spatially unstructured: no taxel is an outlier, and neighbours differ as much as
any two taxels. A contact is smooth; the offsets of taxels are not.
A pad without idle windows has taxels that are unloaded in some scans (`resting.py`). They have the offsets of those
scans, if these are small and unstructured as well; the others have the pad's median, and its spread as the standard
deviation. A pad that is loaded everywhere from the first to the last scan keeps its readings as they are.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from taxelflow.condition.converter import MIN_NOISE_SHARE
from taxelflow.condition.held_load import holds_load
from taxelflow.condition.resting import NEAR_LOAD_SHARE, far_from_loads, find_rest
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.robust import robust_std
from taxelflow.numerics.rounding import CERTAIN, SIGNIFICANT

MAX_OFFSET_SHARE = NEAR_LOAD_SHARE
"""Largest offset as a share of the full scale, if one is declared; for taxels that are idle at times, of the reference
(full scale, or the largest reading). A larger one may be a load."""


@dataclass(frozen=True, slots=True)
class _Structure:
    """When the offsets of a pad have a structure, as a contact has."""

    geary_ratio: float = 0.5
    """Smallest Geary ratio, the mean squared difference of neighbours over that of taxels drawn at random, of an
    unstructured offset. Random offsets of 24 taxels fall below it 3 times in 10,000; a contact does, unless it is about
    as narrow as a taxel."""
    suspect_sigmas: float = 4.5
    suspect_ratio: float = 0.8
    """A pad with a taxel beyond this many robust standard deviations may be a narrow contact: it needs a higher
    ratio."""
    flat_sigmas: float = 2.0
    """Offsets whose standard deviation over the pad is below this many of their own are equal: there is no
    structure."""
    pairs: int = 8
    """With fewer pairs of neighbours the Geary ratio is not significant."""


_STRUCTURE = _Structure()


@dataclass(frozen=True, slots=True)
class _Idle:
    """What is known of a taxel that is idle at times, or clipped."""

    clipped_share: float = 0.02
    """Where a larger share of a pad's readings is clipped, their mean is above the offset: a likelihood gives it."""
    clipped_windows: int = 64
    """Windows that are enough for it, where a pad has been idle."""
    scans: float = 3.0
    """Unloaded scans from which a taxel's offset is known: fewer may be a light load that just pauses."""
    known_share: float = 1 / 3
    """Share of a pad's taxels that must be unloaded at some time: fewer may be the rim of a contact."""
    spreads: float = 2.0
    """Where a taxel is never unloaded together with its neighbours, its own lowest level counts if it is within this
    many standard deviations of the pad's offsets, and loads come on top."""


_IDLE = _Idle()


@dataclass(frozen=True, slots=True, eq=False)
class Offsets:
    """Offsets of one pad. offset: (taxels,). std: (taxels,), its standard deviation. known: (taxels,), found from the
    taxel's own scans; the others have the median of those.
    """

    offset: Floats
    std: Floats
    known: Bools


def idle_windows(windows: Floats, noise: Floats, masked: Bools) -> Floats:
    """The windows of a pad whose sums are lowest, within the noise; none if all have gaps.

    windows: (windows, scans, taxels), NaN where missing. noise, masked: (taxels,).
    """
    complete = windows[(np.isfinite(windows) | masked).all(axis=(1, 2))]
    if not complete.size:
        complete = _filled(windows, masked)
    if not complete.size:
        return complete
    live = complete[:, :, ~masked]
    with np.errstate(over="ignore", invalid="ignore"):
        sums = live.mean(axis=1).sum(axis=1)
        tolerance = CERTAIN * np.sqrt(np.sum(noise[~masked] ** 2) / live.shape[1])
    idle: Floats = complete[sums <= sums.min() + tolerance]
    return idle


def estimate_offset(
    idle: Floats, noise: Floats, masked: Bools, neighbours: NDArray[np.int64], scale: float
) -> Floats | None:
    """Offset of one pad (taxels,) in the unit of its readings, or None if none of its windows was idle.

    idle: (windows, scans, taxels) of this pad, see `idle_windows`. noise, masked: (taxels,). neighbours: (pairs, 2) of
    taxels. scale: full scale in the same unit; infinite if none is declared.
    """
    if not len(idle) or _always_changes(idle[:, :, ~masked], noise[~masked]):
        return None
    offset = np.zeros(len(masked))
    offset[~masked] = idle[:, :, ~masked].mean(axis=(0, 1))
    offset_std = float(noise.max()) / np.sqrt(idle.shape[0] * idle.shape[1])
    small = np.abs(offset).max() <= MAX_OFFSET_SHARE * scale
    return offset if small and is_unstructured(offset, masked, neighbours, offset_std) else None


def _always_changes(windows: Floats, noise: Floats) -> bool:
    """Whether some taxel of each window (windows, scans, taxels) differs between its halves by more than noise
    (taxels,) explains, as under an object that slides.
    """
    scans = windows.shape[1]
    half = scans // 2
    if not half:
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        change = np.abs(windows[:, :half].mean(axis=1) - windows[:, half:].mean(axis=1))
    certain = change > CERTAIN * noise * np.sqrt(1.0 / half + 1.0 / (scans - half))
    return bool(certain.any(axis=1).all())


def _filled(windows: Floats, masked: Bools) -> Floats:
    """Windows of a pad that is never complete: a missing reading takes the mean of its taxel in its window.

    Windows in which some taxel is missing in half of the scans or more are left out.
    """
    known = np.isfinite(windows)
    count = known.sum(axis=1, keepdims=True)
    mean = np.sum(windows, axis=1, keepdims=True, where=known) / np.maximum(count, 1)
    mostly_known = (2 * count[:, 0] > windows.shape[1]) | masked
    filled: Floats = np.where(known, windows, mean)[mostly_known.all(axis=1)]
    return filled


def is_unstructured(offset: Floats, masked: Bools, neighbours: NDArray[np.int64], offset_std: float) -> bool:
    """Whether an offset (taxels,) looks like that of electronics, not like a contact.

    offset_std: standard deviation of the offset of one taxel. The spatial test is Geary's contiguity ratio
    (R. C. Geary, The Contiguity Ratio and Statistical Mapping, The Incorporated Statistician 5, 1954).
    """
    live = offset[~masked]
    middle = float(np.median(live))
    largest, spread = float(np.abs(live - middle).max()), max(robust_std(live, middle), offset_std)
    if largest > CERTAIN * spread:
        return False
    pairs = neighbours[~masked[neighbours].any(axis=1)]
    if len(pairs) < _STRUCTURE.pairs:
        return bool(np.abs(live).max() <= CERTAIN * offset_std)
    variance = float(np.var(live))
    if variance <= (_STRUCTURE.flat_sigmas * offset_std) ** 2:
        return True
    neighbour_variance = float(np.mean((offset[pairs[:, 0]] - offset[pairs[:, 1]]) ** 2)) / 2
    suspect = largest > _STRUCTURE.suspect_sigmas * spread
    return neighbour_variance >= (_STRUCTURE.suspect_ratio if suspect else _STRUCTURE.geary_ratio) * variance


def find_offsets(
    windows: Floats,
    noise: Floats,
    masked: Bools,
    near: NDArray[np.int64],
    neighbours: NDArray[np.int64],
    *,
    scale: float,
    reference: float,
    cut: Floats | float,
) -> Offsets | None:
    """Offsets of one pad: by its idle windows, else by the scans in which its taxels are unloaded; None if unknown.

    Idle windows that are clipped go through the same likelihood, alone, too: skins that relax read less after a load.
    Where all windows give another offset, that of the idle ones counts.

    windows: (windows, scans, taxels). The rest is as in `estimate_offset` and `rest_offset`.
    """
    at_rest = partial(
        rest_offset, noise=noise, masked=masked, near=near, neighbours=neighbours, reference=reference, cut=cut
    )
    idle = idle_windows(windows, noise, masked)
    mean = estimate_offset(idle, noise, masked, neighbours, scale)
    if mean is None or holds_load(mean, windows, noise, masked):
        if not np.isfinite(reference):  # something is loaded: what a stream has read by now shows how far
            reference = float(np.max(windows, initial=0.0, where=np.isfinite(windows)))
        return at_rest(windows.reshape(-1, windows.shape[2]), reference=reference)
    by_mean = Offsets(mean, noise / windows.shape[1] ** 0.5, np.ones(len(mean), dtype=np.bool_))
    if (idle <= cut)[:, :, ~masked].mean() < _IDLE.clipped_share:
        return by_mean
    some, before = (one[:: 1 + len(one) // _IDLE.clipped_windows].reshape(-1, one.shape[2]) for one in (windows, idle))
    found, alone = at_rest(some), at_rest(before) or by_mean
    if found is None:
        return alone
    apart = np.abs(found.offset - alone.offset) > SIGNIFICANT * np.hypot(found.std, alone.std)
    apart |= ~found.known
    return Offsets(*(np.where(apart, *pair) for pair in zip(astuple(alone), astuple(found), strict=True)))


def rest_offset(
    readings: Floats,
    noise: Floats,
    masked: Bools,
    near: NDArray[np.int64],
    neighbours: NDArray[np.int64],
    reference: float,
    cut: Floats | float,
) -> Offsets | None:
    """Offsets of one pad from the scans in which a taxel and its neighbours are unloaded; None if too few ever are.

    readings: (scans, taxels), NaN where missing. near: (taxels, most), see `near_taxels`. cut: (taxels,) or one for
    all; readings that would be lower are clipped. reference: full scale or largest reading, in the same unit; infinite
    if unknown. The rest is as in `estimate_offset`.
    """
    live = ~masked
    used = np.where(live & np.isfinite(readings), readings, np.nan)
    far = far_from_loads(used, near)
    sigma = np.where(live, noise, 1.0)
    loudest = float(sigma.max())
    reach = max(reference, loudest) if np.isfinite(reference) else loudest / MIN_NOISE_SHARE
    rest = find_rest(far, sigma, cut, reach)
    scans = rest.unloaded.sum(axis=0)
    lowest = np.minimum(cut, np.min(far, initial=np.inf, where=np.isfinite(far)))
    level, std = np.maximum(rest.level, lowest), sigma / np.sqrt(np.maximum(scans, 1.0))
    known = _never_loaded_left_out(level, std, live & (scans >= _IDLE.scans), near)
    if known.sum() < max(2.0, _IDLE.known_share * live.sum()):
        return None
    small = np.abs(level[known]).max() <= MAX_OFFSET_SHARE * reference
    if not small or not is_unstructured(level, ~known, neighbours, float(np.median(std[known]))):
        return None
    middle, spread = _middle_and_spread(level[known], std[known])
    beside = find_rest(used, sigma, cut, reach)
    near_idle = ~known & live & (beside.unloaded.sum(axis=0) >= 1.0)
    near_idle &= np.abs(beside.level - middle) <= _IDLE.spreads * spread
    near_idle &= (
        np.max(readings, axis=0, initial=-np.inf, where=np.isfinite(readings)) > middle + LOADED.sigmas * spread
    )
    offset = np.where(known, level, np.where(near_idle, np.maximum(beside.level, lowest), middle))
    std = np.where(known, std, np.where(near_idle, np.minimum(np.maximum(0.5 * spread, std), spread), spread))
    return Offsets(np.where(live, offset, 0.0), np.where(live, std, 0.0), known)


def _middle_and_spread(level: Floats, std: Floats) -> tuple[float, float]:
    """Median of levels (n,), and their standard deviation about it, at least that which they have by themselves."""
    middle = float(np.median(level))
    return middle, max(robust_std(level, middle), float(np.median(std)))


def _never_loaded_left_out(level: Floats, std: Floats, known: Bools, near: NDArray[np.int64]) -> Bools:
    """known (taxels,) without those whose level is a load, and their neighbours: the skirt of that load."""
    while known.any():
        middle, spread = _middle_and_spread(level[known], std[known])
        loaded = known & (level > middle + LOADED.sigmas * spread)
        if not loaded.any():
            break
        known = known & ~loaded & ~loaded[near].any(axis=1)
    return known
