"""What all plants share: the world, how pads touch what they hold, and the sheets that measure depth.

The solver's settings are pinned, since others let a held object creep: pyramidal cones by 1.6 to 8.3 mm/s at twice the
least grip, elliptic cones without noslip iterations by 50 to 308 um/s, and noslip iterations that stop at their default
tolerance by 4 to 8 um/s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.simulation.mujoco.objects import Shape
    from taxelflow.simulation.mujoco.skin import Skin

TIMESTEP_S = 0.0005
"""So short that the contacts' damping, which the solver treats explicitly, is stable for a face with many contacts."""
_OPTION = (
    f'<option timestep="{TIMESTEP_S}" gravity="0 0 0" cone="elliptic" impratio="100" noslip_iterations="10" '
    'noslip_tolerance="0" integrator="implicitfast"/>'
)
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


def scene(shape: Shape, inertial: str, sheets: str, mechanism: str, fixtures: str = "") -> str:
    """MJCF of a world with the object. z is up; the object's frame is the world's.

    inertial: attributes of the object's mass; contacts are as soft as the masses at compile time make them. sheets: of
    the pads. mechanism: equalities, actuators and sensors. fixtures: what else is in the world.
    """
    return f"""
<mujoco>
  {_OPTION}
  <visual><global offwidth="960" offheight="720"/><headlight ambient="0.45 0.45 0.45" diffuse="0.5 0.5 0.5"/>
    <map znear="0.02"/></visual>
  <asset>
    {sheets}{shape.mesh}
    <texture type="skybox" builtin="gradient" rgb1="0.95 0.96 0.98" rgb2="0.65 0.7 0.78" width="64" height="256"/>
  </asset>
  <worldbody>
    <light pos="0.2 -0.4 0.6" dir="-0.3 0.6 -1"/>{fixtures}
    <body name="object">
      <freejoint/>
      <inertial {inertial}/>
      {shape.geoms}
    </body>
  </worldbody>{mechanism}
</mujoco>"""


def mechanism(joints: dict[str, str], bandwidth_hz: float, most: float, couplings: str, sheets: dict[str, str]) -> str:
    """MJCF of the joints that are driven, by name of their actuators, and of a tactile sensor for each pad.

    bandwidth_hz: of the actuators. most: largest control, N or Nm. couplings: equalities. sheets: name of the mesh by
    pad.
    """
    lag_s = 1 / (2 * np.pi * bandwidth_hz)
    drives = "".join(
        f'<general name="{name}" joint="{joint}" dyntype="filterexact" dynprm="{lag_s}" '
        f'gaintype="fixed" gainprm="1" ctrllimited="true" ctrlrange="{-most} {most}"/>'
        for name, joint in joints.items()
    )
    sensors = "".join(f'<tactile name="{pad}" geom="{pad}_skin" mesh="{mesh}"/>' for pad, mesh in sheets.items())
    return f"""
  <equality>{couplings}</equality>
  <actuator>{drives}</actuator>
  <sensor>{sensors}</sensor>"""


def add_contacts(spec: Any, pads: Sequence[str], friction: float) -> None:
    """Let pads touch all geoms of the object that collide. spec: MuJoCo's MjSpec with the body `object`.

    Pairs, because only they may damp friction otherwise than the normal.
    """
    for number, geom in enumerate(spec.body("object").geoms):
        if not geom.contype:
            continue
        geom.name = f"object{number}"
        for pad in pads:
            pair = spec.add_pair(geomname1=f"{pad}_pad", geomname2=geom.name, condim=4)
            pair.friction[:] = [friction, friction, TORSION_M, ROLLING_M, ROLLING_M]
            pair.solref[:], pair.solreffriction[:] = NORMAL_SOLREF, FRICTION_SOLREF
            pair.solimp[:2] = IMPEDANCE


def sheet(name: str, skin: Skin) -> str:
    """MJCF of a flat mesh with a vertex at each place of the skin."""
    places, cols = skin.places_m(), skin.cols * skin.fine
    corner = (np.arange(skin.rows * skin.fine - 1)[:, None] * cols + np.arange(cols - 1)).reshape(-1, 1)
    faces = np.concatenate([corner + np.array([0, cols, 1]), corner + np.array([1, cols, cols + 1])])
    vertex = " ".join(f"{x:.6g} {y:.6g} 0" for x, y in places)
    return f'<mesh name="{name}" vertex="{vertex}" face="{" ".join(map(str, faces.ravel()))}" inertia="shell"/>'
