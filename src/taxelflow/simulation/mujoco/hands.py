"""The plants by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taxelflow.errors import NameUnknown
from taxelflow.simulation.mujoco.barrett import BarrettHand
from taxelflow.simulation.mujoco.gripper import Gripper
from taxelflow.simulation.mujoco.objects import HAND_OBJECTS, STANDARD_OBJECTS
from taxelflow.simulation.mujoco.skin import Skin

if TYPE_CHECKING:
    from taxelflow.simulation.mujoco.plant import Actuator, Grip, Held

HANDS = {"gripper": "two facing pads of 16x16 taxels", "barrett": "the BarrettHand with its 162 taxels"}
"""Hands by name."""
DEFAULT_OBJECTS = {"gripper": STANDARD_OBJECTS, "barrett": HAND_OBJECTS}
"""Objects that are held in turn, by hand."""


def grip(hand: str, held: Held, actuator: Actuator, seed: int, skin: Skin | None = None) -> Grip:
    """A plant. skin: of the gripper; the hand's follows from its sensor. Raises NameUnknown, ExtraMissing."""
    if hand not in HANDS:
        raise NameUnknown("hand", hand, HANDS)
    if hand == "barrett":
        return BarrettHand(held, actuator, seed=seed)
    return Gripper(held, skin or Skin(), actuator, seed=seed)
