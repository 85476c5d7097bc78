"""Pictures of the plant, rendered off screen: by EGL, else by OSMesa, without a display."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from taxelflow.errors import GraphicsMissing
from taxelflow.simulation.mujoco.plants import PICTURE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from taxelflow.messages import Floats


@dataclass(frozen=True)
class View:
    """From where a plant is seen in pictures: the point looked at in the world, and the camera's place around it."""

    looks_at_m: tuple[float, float, float]
    distance_m: float
    azimuth_deg: float
    elevation_deg: float


@dataclass(frozen=True)
class Arrow:
    """An arrow between two places (3,) of the world, in a colour such as "#0072b2"."""

    start_m: Floats
    end_m: Floats
    color: str


class Viewed(Protocol):
    """A plant at work, as far as a camera needs it."""

    @property
    def view(self) -> View:
        """From where it is seen."""
        ...

    @property
    def model(self) -> Any:
        """MuJoCo's model."""
        ...

    @property
    def data(self) -> Any:
        """MuJoCo's state."""
        ...


class Camera:
    """A camera on a plant, with its own place. Close it, or use it as a context manager."""

    def __init__(self, grip: Viewed, height: int = 480, width: int = 480) -> None:
        """Raises GraphicsMissing where neither EGL nor OSMesa works."""
        import mujoco

        self._mujoco: Any = mujoco
        self._grip, self._context = grip, _context(height, width)
        self._scene = mujoco.MjvScene(grip.model, PICTURE.most_geoms)
        self._renderer = mujoco.MjrContext(grip.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        self._options, self._view = mujoco.MjvOption(), mujoco.MjvCamera()
        self._view.lookat[:] = grip.view.looks_at_m
        self._view.distance = grip.view.distance_m
        self._view.azimuth, self._view.elevation = grip.view.azimuth_deg, grip.view.elevation_deg
        self._picture = mujoco.MjrRect(0, 0, width, height)
        self._size = (height, width, 3)

    def frame(self, joints: Floats | None = None, arrows: Callable[[], Sequence[Arrow]] = tuple) -> NDArray[np.uint8]:
        """(height, width, 3), the plant now, or moved to where all its joints have these positions.

        arrows: drawn as well; asked for when the plant is in its place.
        """
        mujoco, pixels = self._mujoco, np.empty(self._size, dtype=np.uint8)
        self._context.make_current()
        grip, everything = self._grip, mujoco.mjtCatBit.mjCAT_ALL
        if joints is not None:
            grip.data.qpos[:] = joints
            mujoco.mj_kinematics(grip.model, grip.data)
            mujoco.mj_comPos(grip.model, grip.data)
        mujoco.mjv_updateScene(grip.model, grip.data, self._options, None, self._view, everything, self._scene)
        for arrow in arrows():
            self._add(arrow)
        mujoco.mjr_render(self._picture, self._scene, self._renderer)
        mujoco.mjr_readPixels(pixels, None, self._picture, self._renderer)
        return pixels[::-1].copy()

    def _add(self, arrow: Arrow) -> None:
        """One more geom of the scene."""
        mujoco, geom = self._mujoco, self._scene.geoms[self._scene.ngeom]
        rgba = np.array([int(arrow.color[at : at + 2], 16) / 255 for at in (1, 3, 5)] + [1.0], dtype=np.float32)
        kind, size, place = mujoco.mjtGeom.mjGEOM_ARROW, np.zeros(3), np.zeros(3)
        mujoco.mjv_initGeom(geom, kind, size, place, np.eye(3).ravel(), rgba)
        eye = np.mean([self._scene.camera[side].pos for side in (0, 1)], axis=0)
        start_m, end_m = (place_m + PICTURE.nearer * (eye - place_m) for place_m in (arrow.start_m, arrow.end_m))
        mujoco.mjv_connector(geom, kind, PICTURE.arrow_m, start_m, end_m)
        self._scene.ngeom += 1

    def close(self) -> None:
        """Give the graphics context back."""
        self._renderer.free()
        self._context.free()

    def __enter__(self) -> Camera:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _context(height: int, width: int) -> Any:
    """A current OpenGL context without a window."""
    failed = []
    for name in ("egl", "osmesa"):
        try:
            context = import_module(f"mujoco.{name}").GLContext(width, height)
            context.make_current()
        except Exception as error:  # PyOpenGL fails in many ways, from ImportError to AttributeError
            failed.append(f"{name}: {error}")
        else:
            return context
    raise GraphicsMissing("; ".join(failed))
