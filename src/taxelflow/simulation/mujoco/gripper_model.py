"""The gripper and what it holds as MJCF.

World: x is the closing axis, z is up. The left pad's x axis runs along world y, the right pad's against it; both pads'
y axes run along world z.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from taxelflow.simulation.mujoco.plants import CONTACT, SOLVER
from taxelflow.simulation.mujoco.scene import mechanism, scene, sheet

if TYPE_CHECKING:
    from taxelflow.simulation.mujoco.objects import Shape
    from taxelflow.simulation.mujoco.plant import Actuator
    from taxelflow.simulation.mujoco.skin import Skin

SIDES = ("left", "right")
_COUPLED = '<joint joint1="left" joint2="right" solref="{:g} {:g}"/>'.format(*SOLVER.coupling_solref)


def mjcf(shape: Shape, inertial: str, skin: Skin, actuator: Actuator) -> str:
    """The model's text, without contacts. inertial: attributes of the object's mass."""
    half_x, half_y = skin.cols * skin.pitch_m / 2, skin.rows * skin.pitch_m / 2
    pads = "".join(
        f"""
    <body name="{side}" pos="{sign * (shape.half_m + CONTACT.gap_m)} 0 0">
      <joint name="{side}" type="slide" axis="{-sign} 0 0" damping="20" range="-0.05 0.06"/>
      <geom name="{side}_pad" type="box" size="0.006 {half_x} {half_y}" pos="{sign * 0.006} 0 0" mass="0.08"
        rgba="0.15 0.15 0.17 1"/>
      <geom name="{side}_skin" type="mesh" mesh="skin" pos="{-sign * CONTACT.sheet_m} 0 0" xyaxes="0 {-sign} 0 0 0 1"
        contype="0" conaffinity="0" group="4" mass="0"/>
      <site name="{side}" xyaxes="0 {-sign} 0 0 0 1" group="4"/>
      <geom type="box" size="0.008 0.012 {half_y + 0.03}" pos="{sign * 0.02} 0 0.03" rgba="0.75 0.75 0.78 1"
        contype="0" conaffinity="0" mass="0.05"/>
    </body>"""
        for side, sign in zip(SIDES, (-1, 1), strict=True)
    )
    fixtures = f"""{pads}
    <geom type="box" size="0.09 0.016 0.01" pos="0 0 {half_y + 0.07}" rgba="0.3 0.32 0.36 1" contype="0"
      conaffinity="0"/>"""
    both = dict(zip(SIDES, SIDES, strict=True))
    moving = mechanism(both, actuator.bandwidth_hz, actuator.max_n, _COUPLED, dict.fromkeys(SIDES, "skin"))
    return scene(shape, inertial, sheet("skin", skin), moving, fixtures)
