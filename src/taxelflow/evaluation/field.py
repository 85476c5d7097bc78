"""Score field: translation and rotation of an object over the whole hand, against truth, by number of slip vectors.

The paper's claim: more slip vectors (more groups) give a more accurate rotation. Each variant cuts the same scans of
the same hand into other pads and groups.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
from rich.console import Console

from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.cells import caption, seeds_from, short, shown
from taxelflow.evaluation.statistics import rms
from taxelflow.numerics.geometry import wrapped
from taxelflow.pipeline import api
from taxelflow.runtime.checks import at_least
from taxelflow.sensors.pads import Group, Pad, Patch
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording, Truth
    from taxelflow.estimation.base import Estimator
    from taxelflow.evaluation.base import Table, Watch
    from taxelflow.messages import Floats

SCENES = ("turn-over-hand", "slide-and-turn-over-hand")


class FieldRow(msgspec.Struct, frozen=True):
    """Errors of one method and one way of cutting up the hand, over all scans and seeds of a scenario."""

    scenario: str
    method: str
    vectors: int
    """Slip vectors of the hand that may take part."""
    cut: str
    direction_deg: float | None
    """Median error of the direction of translation at the hand's origin, where it moves."""
    speed_percent: float | None
    """RMSE of the velocity there, in percent of the RMS of the true one."""
    turn_percent: float
    """RMSE of the rate of turn, in percent of the RMS of the true one."""
    turn_bias_percent: float
    """Mean error of the rate of turn, along its sign: negative is too slow."""
    scans: int


class _Cut(NamedTuple):
    name: str
    sensor: Sensor


@dataclass(frozen=True)
class Field:
    """Measure motion over the hand by number of slip vectors.

    An object turns, or slides and turns, over the whole hand.
    """

    seeds: int = 10
    """Recordings of each scenario, 1 or more; seeds 0, 1, ..."""
    methods: tuple[str, ...] = ("convolution",)
    """Estimators to score."""
    moves_m_s: float = 0.003
    """Speed of the object, in truth, above which direction and speed are scored, m/s."""
    turns_rad_s: float = 0.05
    """Rate of turn, in truth, above which it is scored, rad/s."""

    def __post_init__(self) -> None:
        at_least("seeds", self.seeds, 1)

    def run(self, watched: Watch = unwatched) -> FieldReport:
        """Run the recordings of every scenario through every cut of the hand. Raises NameUnknown."""
        kinds = {method: api.estimator(method) for method in self.methods}
        rows = []
        for scene in SCENES:
            errors: dict[tuple[str, str], list[tuple[Floats, Floats]]] = {}
            cuts: list[_Cut] = []
            for seed in watched(range(self.seeds), "seeds"):
                recording = simulate(replace(SCENARIOS[scene], seed=seed))
                cuts = cuts_of(recording.sensor)
                for cut, (method, kind) in product(cuts, kinds.items()):
                    found = _twists(replace(recording, sensor=cut.sensor), kind)
                    errors.setdefault((method, cut.name), []).append(found)
            for method, cut in product(kinds, cuts):
                twists = map(np.concatenate, zip(*errors[method, cut.name], strict=True))
                rows.append(self._row(scene, method, cut, *twists))
        return FieldReport(self.seeds, rows)

    def _row(self, scene: str, method: str, cut: _Cut, estimated: Floats, true: Floats) -> FieldRow:
        speed, turn = np.hypot(true[:, 0], true[:, 1]), true[:, 2]
        moves = speed > self.moves_m_s
        turns = (np.abs(turn) > self.turns_rad_s) & np.isfinite(estimated[:, 2])
        between = np.arctan2(estimated[moves, 1], estimated[moves, 0]) - np.arctan2(true[moves, 1], true[moves, 0])
        off = np.abs(wrapped(between))
        error = np.hypot(*(estimated - true)[moves, :2].T)
        wrong = (estimated - true)[turns, 2]
        return FieldRow(
            scenario=scene,
            method=method,
            vectors=int(_vectors(cut.sensor)),
            cut=cut.name,
            direction_deg=float(np.degrees(np.median(off))) if moves.any() else None,
            speed_percent=100 * rms(error) / rms(speed[moves]) if moves.any() else None,
            turn_percent=100 * rms(wrong) / rms(turn[turns]),
            turn_bias_percent=100 * float(np.mean(np.sign(turn[turns]) * wrong)) / float(np.mean(np.abs(turn[turns]))),
            scans=len(estimated),
        )


class FieldReport(msgspec.Struct, frozen=True):
    """All rows."""

    seeds: int
    rows: list[FieldRow]

    def tables(self) -> list[Table]:
        """The rows."""
        return [table_of("rows", self.rows, FieldRow)]

    def show(self) -> None:
        """Errors of translation and rotation, a table for each scenario."""
        console = Console(markup=False)
        for scenario in dict.fromkeys(row.scenario for row in self.rows):
            title = f"{scenario}, {seeds_from(0, self.seeds)}"
            table = shown(
                [row for row in self.rows if row.scenario == scenario],
                *(("vectors", "vectors"), ("hand:", "cut")),
                ("method:", lambda row: short(row.method)),
                *(
                    ("direction deg", "direction_deg", 1),
                    ("speed %", "speed_percent", 1),
                    ("turn %", "turn_percent", 1),
                ),
                ("turn bias %", lambda row: f"{row.turn_bias_percent:+.1f}"),
                title=title,
            )
            console.print(table)
            console.print()
        caption(
            console,
            "direction: median; speed and turn: RMSE over the RMS of the true one; at the hand's origin",
        )


def cuts_of(hand: Sensor) -> list[_Cut]:
    """Ways to cut up the paper's hand, from two slip vectors to many."""
    tips = {"finger1_tip", "finger2_tip"}
    fingers = tips | {"finger1_mid", "finger2_mid"}
    everything = {pad.name for pad in hand.pads}
    return [
        _Cut("tips of fingers 1, 2", _kept(hand, tips, 1)),
        _Cut("fingers 1, 2", _kept(hand, fingers, 1)),
        _Cut("fingers 1, 2, palm", _kept(hand, fingers | {"palm"}, 1)),
        _Cut("fingers 1, 2, palm in 3", _kept(hand, fingers | {"palm"}, 1, hand.groups)),
        _Cut("all, palm in 3", _kept(hand, everything, 1, hand.groups)),
        _Cut("all, each pad in 2", _kept(hand, everything, 2)),
        _Cut("all, each pad in 3", _kept(hand, everything, 3)),
    ]


def _kept(hand: Sensor, names: set[str], parts: int, groups: tuple[Group, ...] = ()) -> Sensor:
    """Only these pads have a place; each is cut into `parts` along its longer side."""
    pads = tuple(
        pad if pad.name in names else msgspec.structs.replace(pad, origin_m=None, angle_rad=0.0) for pad in hand.pads
    )
    if parts > 1:
        groups = tuple(group for pad in pads if pad.name in names for group in _parts(pad, parts))
    return msgspec.structs.replace(hand, pads=pads, groups=groups)


def _parts(pad: Pad, parts: int) -> list[Group]:
    long = pad.rows if pad.rows >= pad.cols else pad.cols
    edges = np.linspace(0, long, parts + 1).round().astype(int)
    spans = [(int(first), int(last) - 1) for first, last in pairwise(edges)]
    side = "rows" if pad.rows >= pad.cols else "cols"
    return [Group(f"{pad.name}_{k}", (Patch(pad.name, **{side: span}),)) for k, span in enumerate(spans)]


def _twists(recording: Recording, method: Estimator) -> tuple[Floats, Floats]:
    """Estimated and true twists (scans, 3) at the hand's origin, where one was estimated."""
    result, truth = api.estimate(recording, method), recording.known_truth
    known = np.isfinite(result.motions.velocity[:, 0])
    slips = result.slips
    window_s = np.nanmax(np.where(slips.valid, slips.span_s + 2 * slips.lag_s, np.nan)[known], axis=1)
    t_s = result.motions.t_s[known]
    return result.motions.velocity[known], true_twist(truth, t_s - window_s, t_s)


def true_twist(truth: Truth, from_s: Floats, to_s: Floats) -> Floats:
    """Mean twist (n, 3) of the object's point at the hand's origin between times (n,)."""
    first, last = truth.pose_at(from_s), truth.pose_at(to_s)
    rate = (last - first) / (to_s - from_s)[:, np.newaxis]
    middle = (first + last) / 2
    twist: Floats = rate + rate[:, 2:] * np.stack([middle[:, 1], -middle[:, 0], np.zeros(len(rate))], axis=1)
    return twist


def _vectors(sensor: Sensor) -> int:
    grouped = {patch.pad for group in sensor.groups for patch in group.patches}
    return len(sensor.groups) + sum(pad.origin_m is not None and pad.name not in grouped for pad in sensor.pads)
