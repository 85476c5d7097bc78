"""The gripper and what it holds as MJCF.

World: x is the closing axis, z is up. The left pad's x axis runs along world y, the right pad's against it; both pads'
y axes run along world z. The solver's settings are pinned, since others let a held object creep: pyramidal cones by
1.6 to 8.3 mm/s at twice the least grip, elliptic cones without noslip iterations by 50 to 308 um/s, and noslip
iterations that stop at their default tolerance by 4 to 8 um/s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from taxelflow.simulation.mujoco.objects import Shape
    from taxelflow.simulation.mujoco.skin import Skin

TIMESTEP_S = 0.0005
"""So short that the contacts' damping, which the solver treats explicitly, is stable for a face with many contacts."""
SIDES = ("left", "right")
_SOLVER = 'cone="elliptic" impratio="100" noslip_iterations="10" noslip_tolerance="0" integrator="implicitfast"'
NORMAL_SOLREF, FRICTION_SOLREF = (-4.0e4, -1000.0), (-1e-9, -20.0)
"""Stiffness and damping of a pad's contact over the effective mass, 1/s^2 and 1/s: along the normal, and of friction.

MuJoCo's friction is convex: a contact that slides at v opens like one whose normal acceleration is mu times the
damping of friction times v. With the normal's damping in both, pads opened until the object slid without contact.
The softness (1 mm at 2 N) lets the depths of the vertices show the object's shape. The damping of the normal keeps
the pads from squealing.
"""
IMPEDANCE = 0.33
"""Of the contacts: so low that their stiffness, and not friction's dilation, decides how deep they are."""
SHEET_M = 0.0015
"""How far the sheet that measures depth lies before the pad's face: deeper than any skin is pressed.

The skin is what is left of these depths when they are lowered to balance the force. On the face itself, narrow ribs
are 0.1 mm deep and fall between the vertices.
"""
TORSION_M, ROLLING_M = 0.003, 0.0001
"""Torsional and rolling friction of a contact, m."""
_GAP_M = 0.012
"""Between an open pad and the object."""


def mjcf(shape: Shape, skin: Skin, bandwidth_hz: float, max_n: float, inertial: str) -> str:
    """The model's text, without contacts. bandwidth_hz: of the actuators, first order. max_n: largest force of a pad.

    inertial: attributes of the object's mass; contacts are as soft as the masses at compile time make them.
    """
    half_x, half_y = skin.cols * skin.pitch_m / 2, skin.rows * skin.pitch_m / 2
    pads = "".join(
        f"""
    <body name="{side}" pos="{sign * (shape.half_m + _GAP_M)} 0 0">
      <joint name="{side}" type="slide" axis="{-sign} 0 0" damping="20" range="-0.05 0.06"/>
      <geom name="{side}_pad" type="box" size="0.006 {half_x} {half_y}" pos="{sign * 0.006} 0 0" mass="0.08"
        rgba="0.15 0.15 0.17 1"/>
      <geom name="{side}_skin" type="mesh" mesh="skin" pos="{-sign * SHEET_M} 0 0" xyaxes="0 {-sign} 0 0 0 1"
        contype="0" conaffinity="0" group="4" mass="0"/>
      <geom type="box" size="0.008 0.012 {half_y + 0.03}" pos="{sign * 0.02} 0 0.03" rgba="0.75 0.75 0.78 1"
        contype="0" conaffinity="0" mass="0.05"/>
    </body>"""
        for side, sign in zip(SIDES, (-1, 1), strict=True)
    )
    actuators = "".join(
        f'<general name="{side}" joint="{side}" dyntype="filterexact" dynprm="{1 / (2 * np.pi * bandwidth_hz)}" '
        f'gaintype="fixed" gainprm="1" ctrllimited="true" ctrlrange="{-max_n} {max_n}"/>'
        for side in SIDES
    )
    sensors = "".join(f'<tactile name="{side}" geom="{side}_skin" mesh="skin"/>' for side in SIDES)
    return f"""
<mujoco>
  <option timestep="{TIMESTEP_S}" gravity="0 0 0" {_SOLVER}/>
  <visual><global offwidth="960" offheight="720"/><headlight ambient="0.45 0.45 0.45" diffuse="0.5 0.5 0.5"/>
    <map znear="0.02"/></visual>
  <asset>
    {_sheet(skin)}{shape.mesh}
    <texture type="skybox" builtin="gradient" rgb1="0.95 0.96 0.98" rgb2="0.65 0.7 0.78" width="64" height="256"/>
  </asset>
  <worldbody>
    <light pos="0.2 -0.4 0.6" dir="-0.3 0.6 -1"/>{pads}
    <geom type="box" size="0.09 0.016 0.01" pos="0 0 {half_y + 0.07}" rgba="0.3 0.32 0.36 1" contype="0"
      conaffinity="0"/>
    <body name="object">
      <freejoint/>
      <inertial {inertial}/>
      {shape.geoms}
    </body>
  </worldbody>
  <equality><joint joint1="left" joint2="right" solref="0.004 1"/></equality>
  <actuator>{actuators}</actuator>
  <sensor>{sensors}</sensor>
</mujoco>"""


def add_contacts(spec: Any, friction: float) -> None:
    """Let both pads touch all geoms of the object that collide. spec: MuJoCo's MjSpec of `mjcf`.

    Pairs, because only they may damp friction otherwise than the normal.
    """
    for number, geom in enumerate(spec.body("object").geoms):
        if not geom.contype:
            continue
        geom.name = f"object{number}"
        for side in SIDES:
            pair = spec.add_pair(geomname1=f"{side}_pad", geomname2=geom.name, condim=4)
            pair.friction[:] = [friction, friction, TORSION_M, ROLLING_M, ROLLING_M]
            pair.solref[:], pair.solreffriction[:] = NORMAL_SOLREF, FRICTION_SOLREF
            pair.solimp[:2] = IMPEDANCE


def _sheet(skin: Skin) -> str:
    """A flat mesh with a vertex at each place of the skin."""
    places, cols = skin.places_m(), skin.cols * skin.fine
    corner = (np.arange(skin.rows * skin.fine - 1)[:, None] * cols + np.arange(cols - 1)).reshape(-1, 1)
    faces = np.concatenate([corner + np.array([0, cols, 1]), corner + np.array([1, cols, cols + 1])])
    vertex = " ".join(f"{x:.6g} {y:.6g} 0" for x, y in places)
    return f'<mesh name="skin" vertex="{vertex}" face="{" ".join(map(str, faces.ravel()))}" inertia="shell"/>'
