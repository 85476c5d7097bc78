"""One trial of a controller: an object is gripped, lifted, and something happens to it. All drawn from one seed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.gravity import G_M_S2
from taxelflow.runtime.checks import at_least, not_negative
from taxelflow.simulation.mujoco.events import Happening
from taxelflow.simulation.mujoco.hands import check_objects, grip
from taxelflow.simulation.mujoco.objects import shape
from taxelflow.simulation.mujoco.plant import Actuator, Held
from taxelflow.simulation.mujoco.plants import TRIAL

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from taxelflow.messages import Floats
    from taxelflow.simulation.mujoco.plant import Grip, Truth
    from taxelflow.simulation.mujoco.skin import Skin


@dataclass(frozen=True)
class Trial:
    """What is held, how, and what happens to it."""

    seed: int
    object: str
    event: str
    held: Held
    first_n: float
    """Force per pad at which the controller takes over."""
    happening: Happening

    @classmethod
    def drawn(cls, seed: int, kind: str, event: str) -> Trial:
        """Everything random about a trial, from its seed. Raises NameUnknown, ParameterInvalid."""
        not_negative("seed", seed)
        random = np.random.default_rng(seed)
        mass_kg, friction = random.uniform(0.1, 0.5), random.uniform(0.35, 0.9)
        offset_m = tuple(random.uniform(-0.003, 0.003, 2).tolist())
        firm = random.uniform(0.75, 0.97) if event == "weak" else random.uniform(1.15, 1.4)
        happening = Happening.drawn(event, mass_kg, random)
        held = Held(shape(kind, random), mass_kg, friction, offset_m=offset_m)
        return cls(seed, kind, event, held, firm * mass_kg * G_M_S2 / (2.0 * friction), happening)

    @classmethod
    def to_slide(cls, seed: int, kind: str, event: str) -> Trial:
        """A trial of a commanded slide: held firmly, and nothing happens."""
        trial = cls.drawn(seed, kind, event)
        return replace(trial, first_n=1.3 * trial.least_n(TRIAL.end_s))

    @classmethod
    def to_pivot(cls, seed: int, kind: str, event: str) -> Trial:
        """A trial of a commanded turn: held firmly, the centre of mass 30 mm beside the pads."""
        trial = cls.drawn(seed, kind, event)
        held = replace(trial.held, offset_m=(TRIAL.lever_m, 0.0))
        return replace(trial, held=held, first_n=6.0 * trial.least_n(TRIAL.end_s))

    def least_n(self, t_s: float) -> float:
        """Force per pad that just carries the load at a time, if friction has not to carry a moment as well."""
        return self.happening.lasting_n(t_s) / (2.0 * self.held.friction)


@dataclass(frozen=True)
class Moment:
    """One scan of a trial. readings: of the plant's pads, in its sensor's unit; of the gripper (2, taxels).

    joints: (joints,), of the plant.
    """

    readings: Floats
    truth: Truth
    joints: Floats


class Rehearsal:
    """A trial at work: the caller commands the force of each scan from the handover on.

    `start` closes the gripper; `step` lets one scan pass. `grasped` is, from the lift on, whether the pads held the
    object with half of the first force or more: a trial without is a fault of the bench, not of a controller.
    """

    def __init__(
        self, trial: Trial, skin: Skin | None = None, actuator: Actuator | None = None, hand: str = "gripper"
    ) -> None:
        """skin: of the gripper. hand: a name of `HANDS`. Raises NameUnknown, ParameterInvalid, ExtraMissing."""
        self.trial = trial
        check_objects(hand, [trial.object])
        self.plant: Grip = grip(hand, trial.held, actuator or Actuator(), trial.seed, skin)
        self.grasped = False

    @property
    def t_s(self) -> float:
        """Time of the next scan's start."""
        return self.plant.t_s

    def start(self) -> Iterator[Moment]:
        """Open, close with 3 N, settle at the first force: all scans before the handover."""
        while self.t_s < TRIAL.lift_s - 1e-9:
            t_s, first_n = self.t_s, self.trial.first_n
            moment = self.step(-5.0 if t_s < TRIAL.open_s else TRIAL.closing_n if t_s < TRIAL.closed_s else first_n)
            self.grasped = self.plant.grasps(moment.truth, first_n)
            yield moment

    def step(self, force_n: float) -> Moment:
        """Let one scan pass."""
        readings, truth = self.plant.scan(force_n, self.trial.happening.load(self.t_s))
        return Moment(readings, truth, self.plant.joints)


def drawn_in_turn(
    seed: int, trials: int, objects: tuple[str, ...], events: tuple[str, ...], draw: Callable[[int, str, str], Trial]
) -> Iterator[Trial]:
    """Trials of seeds seed, seed + 1, ...: objects and events in turn, so that all pairs come before one repeats."""
    at_least("trials", trials, 1)
    cycle = int(np.lcm(len(objects), len(events)))
    for number in range(trials):
        event = events[(number + number // cycle) % len(events)]
        yield draw(seed + number, objects[number % len(objects)], event)
