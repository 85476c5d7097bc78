"""Comparison on another machine, in stated standard deviations, of methods that iterate and of the object's motion.

A method that iterates stops at a small step or a limit of rounds. Rounding decides which scans become keyframes, and
which of two fits with the same likelihood is chosen. The equations of the motion over the hand may be nearly singular.
Poses, displacements and velocities are compared; events and patterns follow from them, and are not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from golden.runs import Run

NEAR = 0.2
"""Standard deviations by which a number may differ."""
MOST = 0.1
"""Share of the numbers of a run that may differ by more, of the scans that may be known in one run only, and of
qualities that may differ."""
ITERATING = ("template", "registration", "principal_axis")
UNDECIDED = frozenset(
    {
        "bulb-pull/template/batch",
        "bulb-pull/template/stream",
        "feet-lift/template/stream",
        "press/template/stream",
        "sdh-bags/slip_up.bag/template/batch",
        "sdh-dsa/slip_and_rotation_teapot_handle.dsa/lnorm/batch",
        "sdh-dsa/slip_and_rotation_teapot_handle.dsa/lnorm/stream",
        "sdh-dsa/slip_and_rotation_teapot_handle.dsa/template/batch",
        "sdh-dsa/slip_and_rotation_teapot_handle.dsa/template/stream",
        "sdh-dsa/tennisball.dsa/template/stream",
        "stick-slip/template/stream",
        "stroke/template/batch",
        "two-contacts/template/stream",
    }
)
"""Runs of which rounding decides more: fits with the same likelihood have other poses, an angle is known or not
(`slip_up`), or the fit of a slide that is held against rest ends in another minimum (`lnorm`)."""
STATED = {
    "slips.pose": "slips.covariance",
    "slips.displacement": "slips.displacement_covariance",
    "motions.pose": "motions.pose_covariance",
    "motions.velocity": "motions.velocity_covariance",
}


def iterates(name: str) -> bool:
    """Whether the method of a run iterates. name: SCENARIO/METHOD/MODE."""
    return name.split("/")[-2] in ITERATING


def is_plain(field: str) -> bool:
    """Whether a field of a run that does not iterate is computed in a fixed number of well-posed steps."""
    return not field.partition(":")[2].startswith("motions.")


def first_deviation(golden: Run, run: Run) -> str:
    """The first of the stated numbers that differs too much, in words; empty if there is none."""
    for field, covariance in STATED.items():
        was, now = golden.get(f"kept:{field}"), run.get(f"kept:{field}")
        if was is None and now is None:
            continue
        if was is None or now is None or was.shape != now.shape:
            return f"{field} is known in one run only"
        apart = np.isfinite(was) != np.isfinite(now)
        known = np.isfinite(was) & np.isfinite(now)
        if apart.sum() > MOST * max(known.sum(), 1):
            return f"{field} is known in one run only in {apart.sum()} of {known.sum() + apart.sum()} numbers"
        std = np.hypot(_std(golden[f"kept:{covariance}"]), _std(run[f"kept:{covariance}"]))
        far = known & ~(np.abs(now - was) <= NEAR * std)
        if far.sum() > MOST * known.sum():
            place = tuple(np.argwhere(far)[0].tolist())
            return (
                f"{field} differs by more than {NEAR:g} standard deviations in {far.sum()} of {known.sum()} numbers; "
                f"{list(place)} (kept scans) was {was[place]!r}, is {now[place]!r}, +-{std[place]:.1g}"
            )
    was, now = golden.get("kept:slips.quality"), run.get("kept:slips.quality")
    if was is not None and now is not None and np.mean(was != now) > MOST:
        return f"slips.quality differs in {np.mean(was != now):.0%} of the kept scans"
    return ""


def _std(covariance: np.ndarray) -> np.ndarray:
    std: np.ndarray = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return std
