"""The centre of pressure as a witness of a sum of steps: it does not drift, nor depend on turns that are too small.

The pose of a rigid object and its centre of pressure stay at one distance in the object, that of the first scan of the
whole contact. The covariance of the distance is that of the pose, with errors that stay with the taxels, and those of
the centres in both scans, see `numerics.centroid`.
"""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.scan_matching.track import Scan, Taxels, Track, drift_of, variance_of
from taxelflow.numerics.centroid import CELL_ERROR, centroid_covariance, count_loaded, pressure_centre
from taxelflow.numerics.robust import CLEARLY, GATE
from taxelflow.numerics.small_linalg import inverse2
from taxelflow.runtime.compiling import routine


@routine
def contradicts(scan: Scan, taxels: Taxels, track: Track) -> bool:
    """Whether the centre of pressure of a scan contradicts the pose of its track.

    On a sensor without an unseen error the covariance of the centre is unknown: nothing is contradicted.
    """
    middle, found = np.empty(5), np.empty(9)
    reading, variance, places = scan.reading, scan.variance, taxels.places
    count = count_loaded(reading, variance) if taxels.tilt > 0.0 else 0
    if count == 0:
        return False
    pressure_centre(reading, variance, places, np.zeros(len(reading), np.bool_), middle)
    centroid_covariance(reading, variance, scan.ceiling, places, middle, CELL_ERROR, taxels.tilt, found)
    x, y = track.pose[0] - middle[0], track.pose[1] - middle[1]
    if count > CLEARLY * track.loaded:  # the contact has formed since
        track.loaded, track.angle = count, track.pose[2]
        track.apart[0], track.apart[1] = x, y
        for a in range(3):
            track.doubt[a] = found[a] + found[3 + a]
        return False
    turn = track.pose[2] - track.angle
    cos, sin = np.cos(turn), np.sin(turn)
    x -= cos * track.apart[0] - sin * track.apart[1]
    y -= sin * track.apart[0] + cos * track.apart[1]
    for a, (i, j) in enumerate(((0, 0), (0, 1), (1, 1))):
        found[a] += found[3 + a] + track.doubt[a]
        found[a] += variance_of(track, i, j) + drift_of(track, i, j)
    xx, xy, yy = inverse2(found[0], found[1], found[2])
    apart = x * x * xx + 2.0 * x * y * xy + y * y * yy > 2.0 * GATE
    if apart:  # the contact has formed: no later growth gives the distance again
        track.loaded = max(track.loaded, count)
    return bool(apart)
