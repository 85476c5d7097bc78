"""Score hand: the object's pose over the whole hand, against truth and the Cramér-Rao bound of all pads together.

The bound adds up the information of the pads (`bound`), each with its gain and baseline free in every scan and its
pattern known: no unbiased method can do better in a scan. Errors are those of the point that lay at the hand's origin
at first contact; one constant offset a recording is taken off, since the first scan's own error stays in all others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
from rich.console import Console

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.bound import modelled
from taxelflow.evaluation.cells import Column, caption, number, percent, seeds_from, short, shown
from taxelflow.evaluation.field import SCENES
from taxelflow.evaluation.grasp_rows import GraspRow, grasp_rows
from taxelflow.numerics.geometry import rotation
from taxelflow.pipeline import api
from taxelflow.runtime.checks import at_least
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.motion import move
from taxelflow.simulation.relief.parameters import EXPONENT
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from rich.table import Table as Shown

    from taxelflow.evaluation.base import Table, Watch
    from taxelflow.messages import Floats, Motions
    from taxelflow.simulation.scenario import Scenario


class HandRow(msgspec.Struct, frozen=True):
    """One method on one scenario, over all scans with a pose and all seeds."""

    scenario: str
    method: str
    translation_mm: float
    """RMS error of the translation, one constant offset a recording taken off."""
    translation_bound_mm: float
    translation_ratio: float
    turn_deg: float
    turn_bound_deg: float
    turn_ratio: float
    nees: float
    """Mean of e^T C^-1 e / 3 of the pose since first contact, without any fit; 1 if the covariance is right."""
    scans: int


class _Errors(NamedTuple):
    """error: (scans, 3), offset taken off; bound: (scans, 3), standard deviations; nees: (scans,)."""

    error: Floats
    bound: Floats
    nees: Floats


@dataclass(frozen=True)
class Hand:
    """Measure the pose over the whole hand beside its bound.

    An object turns, or slides and turns, over two fingers and the palm.
    """

    seeds: int = 10
    """Number of recordings of each scenario, 1 or more."""
    seed: int = 0
    """Seed of the first recording; the others count up from it."""
    methods: tuple[str, ...] = ("convolution", "template")
    """Estimators to score."""
    grasps: int = 0
    """Recordings of a grasp in space (extra `sim`): elastic contacts, 25 mm/s and 30 deg/s together, moving fingers."""
    exponent: float = 1.0
    """Exponent of the skin's law of pressure over depth in these, 0.8 to 1.5. At 1 it is the law of `template`."""

    def __post_init__(self) -> None:
        at_least("seeds", self.seeds, 1)
        at_least("seed", self.seed, 0)
        at_least("grasps", self.grasps, 0)
        if not EXPONENT.least <= self.exponent <= EXPONENT.most:
            raise ParameterInvalid("exponent", self.exponent, f"be between {EXPONENT.least:g} and {EXPONENT.most:g}")

    def run(self, watched: Watch = unwatched) -> HandReport:
        """Simulate, estimate, compare. Raises NameUnknown."""
        kinds = {method: api.estimator(method) for method in self.methods}
        found: dict[tuple[str, str], list[_Errors]] = {(scene, name): [] for scene in SCENES for name in kinds}
        for seed in watched(range(self.seed, self.seed + self.seeds), "seeds"):
            for scene in SCENES:
                scenario = replace(SCENARIOS[scene], seed=seed)
                recording = simulate(scenario)
                bound = hand_bound(scenario, recording.known_truth.t_s)
                for name, kind in kinds.items():
                    motions = api.estimate(recording, kind).motions
                    found[scene, name].append(_errors(scenario, motions, recording.known_truth.t_s, bound))
        rows = [_row(*key, errors) for key, errors in found.items()]
        return HandReport(self.seeds, self.seed, rows, self._in_space(watched))

    def _in_space(self, watched: Watch) -> list[GraspRow]:
        if not self.grasps:
            return []
        seeds = range(self.seed, self.seed + self.grasps)
        return grasp_rows(self.methods, list(watched(seeds, "grasps")), self.exponent)


class HandReport(msgspec.Struct, frozen=True):
    """All rows."""

    seeds: int
    seed: int
    rows: list[HandRow]
    grasps: list[GraspRow]

    def tables(self) -> list[Table]:
        """The rows on the flat hand, then those in space."""
        return [table_of("rows", self.rows, HandRow), table_of("grasps", self.grasps, GraspRow)]

    def show(self) -> None:
        """One table of all scenarios and methods."""
        console = Console(markup=False)
        table = shown(
            self.rows,
            *(("scenario:", "scenario"), ("method:", "method")),
            ("mm", lambda row: number(row.translation_mm, 4)),
            ("bound mm", lambda row: number(row.translation_bound_mm, 4)),
            ("ratio", "translation_ratio", 2),
            ("deg", "turn_deg", 4),
            ("bound deg", lambda row: number(row.turn_bound_deg, 4)),
            ("ratio", "turn_ratio", 2),
            ("NEES", "nees", 2),
            title=f"pose of the object over the hand, {seeds_from(self.seed, self.seeds)}",
        )
        console.print(table)
        caption(
            console,
            "RMS errors, one constant offset a recording taken off; bound: of one scan, pattern known; "
            "NEES: of the pose since first contact, 1 if the covariance is right.",
        )
        if self.grasps:
            console.print()
            console.print(_twists(self.grasps))
            caption(
                console,
                "window of 0.25 s, 25 mm/s and 30 deg/s together; direction: median, others RMS; "
                "bounds: RMS, patterns and joints known; blamed: strokes in which the pad that "
                "sticks, and no other, is blamed, %",
            )
            console.print()
            console.print(_poses(self.grasps))
            caption(console, "one constant offset taken off; bound: of one scan, patterns and joints known.")


def _twists(rows: list[GraspRow]) -> Shown:
    return shown(
        rows,
        ("twist:", "variant"),
        ("method:", lambda row: short(row.method)),
        *(("dir. deg", "direction_deg", 2), ("bound", lambda row: number(row.direction_bound_deg, 2))),
        *(("speed %", "speed_percent", 2), ("bound", lambda row: number(row.speed_bound_percent, 2))),
        *(("turn %", "turn_percent", 2), ("bound", lambda row: number(row.turn_bound_percent, 2))),
        ("NEES", "nees", 2),
        ("blamed", lambda row: percent(row.blamed_rightly)),
    )


def _poses(rows: list[GraspRow]) -> Shown:
    method: Column = ("method:", lambda row: short(row.method))
    place, turn = (
        (("mm", lambda row: number(row.pose_mm, 3)), ("bound", "bound_mm", 3)),
        (("deg", lambda row: number(row.pose_deg, 3)), ("bound", "bound_deg", 3)),
    )
    return shown(rows, ("pose:", "variant"), method, *place, *turn)


def hand_bound(scenario: Scenario, t_s: Floats) -> Floats:
    """Cramér-Rao standard deviations (scans, 3), m, m, rad, of the object's pose in the hand, pattern known.

    t_s: (scans,), true times. NaN where no pad observes the pose.
    """
    layout = load_sensor(scenario.sensor).layout
    information = np.zeros((len(t_s), 3, 3))
    for pad in range(layout.pad_count):
        if np.isfinite(layout.T_hand[pad]).all():
            by_pose = modelled(scenario, layout, pad, t_s).by_pose
            turn = np.eye(3)
            turn[:2, :2] = rotation(layout.T_hand[pad, 2])
            information += turn @ (np.swapaxes(by_pose, 1, 2) @ by_pose) @ turn.T
    deviation = np.full((len(t_s), 3), np.nan)
    observable = np.linalg.eigvalsh(information)[:, 0] > 0.0
    deviation[observable] = np.sqrt(np.diagonal(np.linalg.inv(information[observable]), axis1=1, axis2=2))
    return deviation


def _errors(scenario: Scenario, motions: Motions, t_s: Floats, bound: Floats) -> _Errors:
    """Of one recording; scans in which a contact first gives a pose have no error by definition and are left out."""
    known = np.isfinite(motions.pose[:, 2])
    first = int(np.argmax(known))
    known &= np.isfinite(bound[:, 2]) & (motions.pose_covariance[:, 2, 2] > 0.0)
    true = move(scenario.motion, t_s, scenario.seed).pose
    turned = true[:, 2] - true[first, 2]
    shift = true[:, :2] - np.einsum("kij,j->ki", rotation(turned), true[first, :2])
    error = (motions.pose - np.column_stack([shift, turned]))[known]
    covariance = motions.pose_covariance[known]
    nees = np.einsum("ki,ki->k", error, np.linalg.solve(covariance, error[..., np.newaxis])[..., 0]) / 3
    return _Errors(error - error.mean(axis=0), bound[known], nees)


def _row(scene: str, method: str, runs: list[_Errors]) -> HandRow:
    error, bound, nees = (np.concatenate(part) for part in zip(*runs, strict=True))
    rms, least = (np.sqrt(np.mean(values**2, axis=0)) for values in (error, bound))
    translation, translation_bound = float(np.hypot(*rms[:2])), float(np.hypot(*least[:2]))
    return HandRow(
        scenario=scene,
        method=method,
        translation_mm=1e3 * translation,
        translation_bound_mm=1e3 * translation_bound,
        translation_ratio=translation / translation_bound,
        turn_deg=float(np.degrees(rms[2])),
        turn_bound_deg=float(np.degrees(least[2])),
        turn_ratio=float(rms[2] / least[2]),
        nees=float(nees.mean()),
        scans=len(error),
    )
