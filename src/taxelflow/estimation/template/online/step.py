"""One scan of the whole hand in one call: its pads registered, and their row of estimates filled in.

The call keeps Python's lock. It takes some microseconds; had it to get the lock back from the thread that learns, it
could take as long as that thread holds it, milliseconds.
"""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.template.online.hand import DISTURBANCE, LAG, SPAN, Hand, Patterns, Rows, Scan
from taxelflow.estimation.template.online.output import report
from taxelflow.estimation.template.online.track_state import NOTHING, Track
from taxelflow.estimation.template.online.tracking import follow
from taxelflow.numerics.records import Records
from taxelflow.runtime.compiling import kernel

FOLLOW, REPORT, BOTH = range(1, 4)
"""What to do with a scan."""
DONE, ELSEWHERE, ASKS = range(3)
"""What came of it: nothing more to do; not reported, because a scan fits where it was not looked for; a pad's flag is
set."""


@kernel
def follow_hand(job: int, k: int, scan: Scan, hand: Hand, maps: Patterns, tracks: Records, rows: Rows) -> int:
    """Register one scan (FOLLOW), overwrite row k of `rows` with its estimates (REPORT), or do BOTH.

    If not all pads fit, BOTH stops before the report.
    """
    if job & FOLLOW:
        fits = follow(scan, hand, maps, tracks)
        if job == FOLLOW or not fits:
            return DONE if fits else ELSEWHERE
    for part in range(2):
        rows.vectors[part, k], rows.matrices[part, k] = np.nan, np.nan
    rows.scalars[SPAN, k], rows.scalars[LAG, k], rows.scalars[DISTURBANCE, k] = np.nan, np.nan, np.nan
    rows.quality[k] = 0
    asks = False
    for pad in range(len(scan.contact)):
        m: Track = tracks[pad]
        m.flag = NOTHING
        if not scan.contact[pad] or not m.active:
            m.continues = False
            continue
        report(scan.t, k, pad, hand.pitch_m[pad], hand.floor, m, hand.room, rows)
        rows.scalars[LAG, k, pad] = -hand.lead_s[pad]
        asks = asks or m.flag != NOTHING
    return ASKS if asks else DONE
