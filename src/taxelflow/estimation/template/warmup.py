"""Kernels run once on a made-up contact, so that none is compiled while scans go by."""

from __future__ import annotations

from functools import cache

import numpy as np

from taxelflow.estimation.template.contact_solver import solve_contact
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.online.hand import PadScan
from taxelflow.estimation.template.online.map_update import learn
from taxelflow.estimation.template.online.relocalization import relocalise
from taxelflow.estimation.template.online.starting import FirstScan, first_pattern
from taxelflow.numerics.blas import on_one_core
from taxelflow.numerics.cut import open_sides


@cache
def compile_batch() -> None:
    """Those of whole contacts, once in a process."""
    with on_one_core():
        solve_contact(made_up())


@cache
def compile_stream() -> None:
    """Those that learn beside a stream, once in a process."""
    scanned = made_up()
    reading, edge = scanned.readings[0], np.zeros(36, np.bool_)
    readings, sides = (reading, scanned.variance[0], scanned.ceiling, reading), open_sides(scanned.places)
    part = PadScan(*readings, scanned.places, edge, sides)
    # with an unseen error, so that the load is a witness, too
    learned = first_pattern(FirstScan(0.0, part, part, np.ones(36), edge, 0.05, scanned.delay_s, np.zeros(2)))
    for k in range(1, len(scanned)):
        state = np.array([0.4 * k - 1.0, 0.0, 0.0, 1.0, 0.0])
        scan = scanned.t_s[k], scanned.readings[k], scanned.variance[k], np.zeros((3, 0)), state
        learned.keyframes = learned.keyframes.with_scan(*scan)
    learned.fresh = len(scanned) - 1
    with on_one_core():
        relocalise(learn(learned), np.zeros(2), part)


def made_up() -> Scanned:
    """Five scans of a dome that slides over 6 x 6 taxels."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(6.0), np.arange(6.0)))
    places = np.stack([x - 2.5, y - 2.5])
    moved = 0.4 * np.arange(5.0)[:, np.newaxis]
    readings = 100.0 * np.exp(-0.5 * ((places[0] - moved + 1.0) ** 2 + places[1] ** 2))
    return Scanned.of(np.arange(5.0), places, readings, np.ones_like(readings), np.full(36, np.inf), np.zeros(36))
