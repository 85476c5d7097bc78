"""What all plants share: the world, how pads touch what they hold, and the sheets that measure depth.

The solver's settings are pinned, since others let a held object creep: pyramidal cones by 1.6 to 8.3 mm/s at twice the
least grip, elliptic cones without noslip iterations by 50 to 308 um/s, and noslip iterations that stop at their default
tolerance by 4 to 8 um/s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.simulation.mujoco.plants import CONTACT, SOLVER

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.simulation.mujoco.objects import Shape
    from taxelflow.simulation.mujoco.skin import Skin

_OPTION = (
    f'<option timestep="{SOLVER.timestep_s}" gravity="0 0 0" cone="elliptic" impratio="100" noslip_iterations="10" '
    'noslip_tolerance="0" integrator="implicitfast"/>'
)


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
            pair.friction[:] = [friction, friction, CONTACT.torsion_m, CONTACT.rolling_m, CONTACT.rolling_m]
            pair.solref[:], pair.solreffriction[:] = CONTACT.normal_solref, CONTACT.friction_solref
            pair.solimp[:2] = CONTACT.impedance


def sheet(name: str, skin: Skin) -> str:
    """MJCF of a flat mesh with a vertex at each place of the skin."""
    places, cols = skin.places_m(), skin.cols * skin.fine
    corner = (np.arange(skin.rows * skin.fine - 1)[:, None] * cols + np.arange(cols - 1)).reshape(-1, 1)
    faces = np.concatenate([corner + np.array([0, cols, 1]), corner + np.array([1, cols, cols + 1])])
    vertex = " ".join(f"{x:.6g} {y:.6g} 0" for x, y in places)
    return f'<mesh name="{name}" vertex="{vertex}" face="{" ".join(map(str, faces.ravel()))}" inertia="shell"/>'
