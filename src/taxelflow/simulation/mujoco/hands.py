"""The plants by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.simulation.mujoco.barrett import BarrettHand
from taxelflow.simulation.mujoco.gripper import Gripper
from taxelflow.simulation.mujoco.objects import PALM_OBJECTS, STANDARD_OBJECTS
from taxelflow.simulation.mujoco.skin import Skin

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.simulation.mujoco.plant import Actuator, Grip, Held

HANDS = {"gripper": "two facing pads of 16x16 taxels", "barrett": "the BarrettHand with its 162 taxels"}
"""Hands by name."""
DEFAULT_OBJECTS = {"gripper": STANDARD_OBJECTS, "barrett": PALM_OBJECTS[:2]}
"""Objects that are held in turn, by hand."""


def check_objects(hand: str, objects: Iterable[str]) -> None:
    """Raises NameUnknown for a hand, ParameterInvalid for an object that does not fit its palm."""
    if hand not in HANDS:
        raise NameUnknown("hand", hand, HANDS)
    for name in objects:
        if hand == "barrett" and name not in PALM_OBJECTS:
            raise ParameterInvalid("objects", name, f"be one of {', '.join(PALM_OBJECTS)} for the BarrettHand")


def grip(hand: str, held: Held, actuator: Actuator, seed: int, skin: Skin | None) -> Grip:
    """The plant of a hand, see `check_objects`. skin: of the gripper; the hand's follows from its sensor.

    Raises ExtraMissing.
    """
    if hand == "barrett":
        return BarrettHand(held, actuator, seed=seed)
    return Gripper(held, skin or Skin(), actuator, seed=seed)
