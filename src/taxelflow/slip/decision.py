"""What slips, scan by scan: by the pose, by the patterns' evidence or by pads that agree; see `verdict`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import AMBIGUOUS, OK, Bools, Bytes, Floats
from taxelflow.runtime.compiling import kernel
from taxelflow.slip.odds import AGAINST


class Flags(NamedTuple):
    """(scans, pads) each. slipping: by the pose; begins: where such a slip does; agreed: by facing pads together.
    sure: the pose of a pad's only contact is `ok`; vague: a pose needs its pattern's consent.
    """

    slipping: Bools
    begins: Bools
    agreed: Bools
    contact: Bools
    restless: Bools
    sure: Bools
    vague: Bools


def decide_block(
    flags: Flags,
    whole: NDArray[np.int64],
    log_odds: tuple[Floats, Floats],
    since_s: Floats,
    last: Bools,
    last_by_odds: Bools,
    final: Bools,
    by_odds: Bools,
) -> bool:
    """`decide` in NumPy."""
    now, soon = log_odds
    judged = np.where(flags.restless, now > 0.0, flags.slipping)
    doubted = ((flags.vague & (soon < AGAINST)) | (since_s == np.inf)) & ~flags.restless
    rests = np.zeros_like(final)
    for pad, part_of in enumerate(whole.tolist()):  # pads come before their groups
        if part_of >= 0:
            rests[:, pad] = flags.sure[:, part_of] & ~final[:, part_of]
        slips = (judged[:, pad] | flags.agreed[:, pad]) & flags.contact[:, pad] & ~rests[:, pad]
        believed = slips & (flags.agreed[:, pad] | ~doubted[:, pad])
        believed[:1] |= slips[:1] & last[:, pad] & ~flags.begins[:1, pad]
        since = np.maximum(_latest(~slips) + 1, _latest(flags.begins[:, pad]))
        final[:, pad] = slips & (_latest(believed) >= since)
    was = np.concatenate([last, final])[:-1]
    by_odds[...] = flags.restless | flags.agreed | rests | (flags.slipping & doubted & (flags.begins | ~was))
    changed = final != was
    return bool((changed & (by_odds | np.concatenate([last_by_odds, by_odds])[:-1])).any())


def _latest(flags: Bools) -> NDArray[np.int64]:
    """(scans,), number of the latest scan up to each that has the flag; -1 if none has."""
    latest: NDArray[np.int64] = np.maximum.accumulate(np.where(flags, np.arange(len(flags)), -1))
    return latest


@kernel
def decide(
    flags: Flags,
    whole: NDArray[np.int64],
    log_odds: tuple[Floats, Floats],
    since_s: Floats,
    last: Bools,
    last_by_odds: Bools,
    final: Bools,
    by_odds: Bools,
) -> bool:
    """Fill what slips, and whether others than its pose decide it, (scans, pads) each; whether they change anything.

    whole: (pads,), see `pads_of_groups`. log_odds: of now, and the highest within the time that a slip takes to show;
    (scans, pads) each. since_s: (scans, pads), see `ShiftingLoad.step`; at inf no slip begins by its pose. last,
    last_by_odds: (1, pads), before.
    """
    now, soon = log_odds
    changes = False
    for scan in range(final.shape[0]):
        for pad in range(final.shape[1]):
            was, by = last[0, pad], last_by_odds[0, pad]
            if scan > 0:
                was, by = final[scan - 1, pad], by_odds[scan - 1, pad]
            slipping, restless = flags.slipping[scan, pad], flags.restless[scan, pad]
            judged = now[scan, pad] > 0.0 if restless else slipping
            unsure = slipping and not restless and (flags.begins[scan, pad] or not was)
            doubted = flags.vague[scan, pad] and soon[scan, pad] < AGAINST
            unsure = unsure and (doubted or since_s[scan, pad] == np.inf)
            judged = judged and not unsure
            part_of = whole[pad]  # pads come before their groups
            rests = part_of >= 0 and flags.sure[scan, part_of] and not final[scan, part_of]
            final[scan, pad] = (judged or flags.agreed[scan, pad]) and flags.contact[scan, pad] and not rests
            by_odds[scan, pad] = restless or flags.agreed[scan, pad] or rests or unsure
            changes |= final[scan, pad] != was and (by or by_odds[scan, pad])
    return changes


@kernel
def find_vague(
    quality: Bytes, border: Bools, contact: Bools, in_part: Bools, visible: Bools, judged: bool, vague: Bools
) -> bool:
    """Fill vague (scans, pads), poses that need their pattern's consent, of a stream; whether its method judges poses
    of cut contacts by now.

    quality, contact: (scans, pads). border: (scans, pads, 2). in_part: (pads,), groups with a part of a pad. visible:
    (scans or 1, pads), slips that began early enough for their pattern to show them. judged: the answer so far.
    """
    scans, pads = quality.shape
    for scan in range(scans):
        for pad in range(pads):
            cut = border[scan, pad, 0] or border[scan, pad, 1]
            judged |= cut and contact[scan, pad] and quality[scan, pad] == OK
        for pad in range(pads):
            cut = border[scan, pad, 0] or border[scan, pad, 1]
            by_border = cut and quality[scan, pad] == AMBIGUOUS and not judged
            waits = in_part[pad] or visible[min(scan, len(visible) - 1), pad]
            vague[scan, pad] = quality[scan, pad] > OK and (not by_border or waits)
    return judged
