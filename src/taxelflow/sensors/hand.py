"""The hand that carries the pads: its model, frame and joint angles, as a sensor file declares them."""

from __future__ import annotations

import re
from math import radians
from typing import TYPE_CHECKING, Annotated

import msgspec
from msgspec import Meta

from taxelflow.errors import SensorFileInvalid, TaxelflowError

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

_MOST_BYTES = 1 << 22
"""Largest model: meshes are not part of a URDF or MJCF."""
_SETTING = re.compile(
    r"(?P<joint>[^\s=,][^=,]*)=(?P<angle>[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?)(?P<unit>deg|rad)?([\s,]+|$)"
)
"""A joint's name may hold blanks: an angle ends a setting, not a blank."""
_PART = re.compile(r"[^=,]*(?:=[^\s,]*)?")
"""What stands in a setting's place."""
Std = Annotated[float, Meta(ge=0, lt=1)]


class HandModelInvalid(TaxelflowError):
    """A hand's URDF or MJCF cannot be used."""

    def __init__(self, source: str, seen: str, remedy: str) -> None:
        super().__init__(f"hand model of {source}: {seen}; {remedy}")


PAIRS = "give JOINT=ANGLE pairs such as 'spread=60deg f1=1.2' (rad without a unit)"
"""What to do about angles that are no pairs, where nothing else is taken."""
PAIRS_POSE_OR_TABLE = f"{PAIRS}, a named pose, or a csv with columns t_s and the joints"
"""The same, where a recording is read."""


class JointsInvalid(TaxelflowError):
    """Joint angles that the user gives cannot be read."""

    def __init__(self, given: str, seen: str, remedy: str = PAIRS_POSE_OR_TABLE) -> None:
        super().__init__(f"joint angles {given!r}: {seen}; {remedy}")


class Hand(msgspec.Struct, frozen=True, forbid_unknown_fields=True, cache_hash=True):
    """Kinematics of the hand. The sensor's pads name its links."""

    urdf: str
    """A URDF or MJCF file, relative to the sensor file, or the name of a built-in hand; in a recording its XML."""
    base: str = ""
    """Link whose frame is the hand's; the root if left out."""
    joints: str = ""
    """Joint angles where a recording has none, as in `spread=60deg f1=1.2`; rad without a unit, 0 if left out."""
    poses: tuple[str, ...] = ()
    """Named sets of joint angles, each `NAME: JOINT=ANGLE ...`."""
    joint_std_rad: Std = 0.0
    """Standard deviation of a joint angle's error, rad (m for a slide)."""
    note: str = ""
    """Remark for the user, such as an assumption."""

    def pose(self, name: str) -> str | None:
        """Joint angles of a named pose, None if there is none of that name."""
        return dict(pose.split(":", 1) for pose in self.poses if ":" in pose).get(name)


def ways(hand: Hand | None, *, table: bool) -> str:
    """How the angles of a hand's joints are given, with the names of its poses. table: a csv is taken, too."""
    names = ", ".join(pose.split(":", 1)[0] for pose in hand.poses) if hand else ""
    named = f"a named pose ({names})" if names else "a named pose"
    return f"{PAIRS}, {named}, or a csv with columns t_s and the joints" if table else f"{PAIRS} or {named}"


def joint_angles(text: str, remedy: str = PAIRS) -> dict[str, float]:
    """Angles in rad by joint from text such as `spread=60deg f1=1.2`. remedy: what else is taken.

    Raises JointsInvalid.
    """
    text, at = text.strip(), 0
    angles: dict[str, float] = {}
    while at < len(text) or not angles:
        found = _SETTING.match(text, at)
        if found is None:
            part = _PART.findall(text, at)[0]
            raise JointsInvalid(text, f"{part!r} is not JOINT=ANGLE", remedy)
        if found["joint"] in angles:
            raise JointsInvalid(text, f"joint {found['joint']!r} has two angles", "give each joint one")
        angle = float(found["angle"])
        angles[found["joint"]] = radians(angle) if found["unit"] == "deg" else angle
        at = found.end()
    return angles


def with_model(hand: Hand | None, folder: Traversable | None, source: str) -> Hand | None:
    """The hand with the text of the model file that it names, if it names one. Raises SensorFileInvalid."""
    if hand is None or hand.urdf.lstrip().startswith("<") or "." not in hand.urdf:
        return hand
    where = "table [hand], field urdf"
    if folder is None:
        seen = f"file {hand.urdf!r}, but the sensor is not read from a file"
        raise SensorFileInvalid(source, where, seen, "give the model's text itself")
    try:
        text = folder.joinpath(hand.urdf).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError, ValueError) as error:
        seen = f"the model {hand.urdf!r} cannot be read ({getattr(error, 'strerror', None) or error})"
        raise SensorFileInvalid(
            source, where, seen, "give the path of a URDF or MJCF relative to the sensor"
        ) from error
    if len(text) > _MOST_BYTES:
        raise SensorFileInvalid(source, where, f"{len(text)} characters", "give a model without meshes, below 4 MB")
    return msgspec.structs.replace(hand, urdf=text)


def check_hand(hand: Hand | None, links: dict[str, str], source: str) -> None:
    """Check the hand's fields, and links by pad. Raises SensorFileInvalid."""
    if hand is None:
        if links:
            pad, link = next(iter(links.items()))
            seen = f"link {link!r} of pad {pad!r} without a hand"
            raise SensorFileInvalid(source, "table [hand]", seen, 'add [hand] with urdf = "FILE"')
        return
    for field, texts in (("joints", [hand.joints] if hand.joints else []), ("poses", list(hand.poses))):
        for text in texts:
            name, colon, angles = text.rpartition(":")
            if field == "poses" and not (colon and name.strip()):
                raise SensorFileInvalid(source, "table [hand], field poses", f"{text!r}", "write NAME: JOINT=ANGLE ...")
            try:
                joint_angles(angles)
            except JointsInvalid as error:
                raise SensorFileInvalid(source, f"table [hand], field {field}", *str(error).split("; ", 1)) from error
