"""Light of the scene, and colours of surfaces that look as asked under it.

The browser maps light to colours by the ACES filmic curve, which makes colours pale. It is inverted here, for a surface
that faces the key light. Curve and matrices: fit by Stephen Hill, as in three.js (`ACESFilmicToneMapping`).
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view.look import LIGHTS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats
    from taxelflow.publish.view.camera import Axes
    from taxelflow.publish.view.look import Light
    from taxelflow.publish.view.palette import Rgb


_LIGHT = (LIGHTS.ambient + LIGHTS.key.intensity * LIGHTS.key.along[2] / float(np.linalg.norm(LIGHTS.key.along))) / np.pi
"""Radiance of a white surface whose normal is z."""
_EXPOSURE = 1 / 0.6
"""Of three.js's ACESFilmicToneMapping."""
_TO_CURVE = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_FROM_CURVE = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
_OVER, _UNDER = np.array([1.0, 0.0245786, -0.000090537]), np.array([0.983729, 0.4329510, 0.238081])
"""The curve is a ratio of two polynomials: their coefficients, the highest power first."""
_HIGHEST = 0.97
"""Of the curve; above it the light that is needed grows without bound."""


def add_lights(scene: Any, axes: Axes, *, space: bool) -> None:
    """Replace the default lights, under which colours are washed out. axes: of the picture, on whose side the key light
    is. space: whether there are surfaces of all directions.
    """
    scene.configure_default_lights(False)
    scene.configure_environment_map(hdri=None)
    scene.add_light_ambient("/lights/ambient", intensity=LIGHTS.ambient)
    scene.add_light_directional("/lights/key", intensity=LIGHTS.key.intensity, position=_position(LIGHTS.key, axes))
    if space:
        scene.add_light_directional(
            "/lights/fill", intensity=LIGHTS.fill.intensity, position=_position(LIGHTS.fill, axes)
        )


def _position(light: Light, axes: Axes) -> tuple[float, ...]:
    return tuple(np.array(light.along) @ np.stack(axes))


def as_lit(colours: Any) -> NDArray[np.uint8]:
    """Reflectances (..., 3), 0 to 255, of surfaces that look like `colours` (..., 3) under the lights, nearly.

    colours: sRGB. A batched mesh takes its colours as they are, not as sRGB.
    """
    wanted = _linear(np.asarray(colours, dtype=np.float64) / 255.0)
    curve = np.clip(wanted @ np.linalg.inv(_FROM_CURVE).T, 0.0, _HIGHEST)
    a, b, c = (over - curve * under for over, under in zip(_OVER, _UNDER, strict=True))
    light = (-b + np.sqrt(np.maximum(b * b - 4 * a * c, 0.0))) / (2 * a)
    surface = light @ np.linalg.inv(_TO_CURVE).T / (_EXPOSURE * _LIGHT)
    found: NDArray[np.uint8] = (255.0 * np.clip(surface, 0.0, 1.0)).round().astype(np.uint8)
    return found


@cache
def lit(colour: Rgb) -> NDArray[np.uint8]:
    """(3,), `as_lit` of one colour of the palette; kept."""
    return as_lit(colour)


def seen(surfaces: Any) -> Floats:
    """sRGB (..., 3) of how surfaces of these reflectances (..., 3) look: the inverse of `as_lit`."""
    light = np.asarray(surfaces, dtype=np.float64) / 255.0 * _LIGHT * _EXPOSURE
    v = light @ _TO_CURVE.T
    curve = np.polyval(_OVER, v) / np.polyval(_UNDER, v)
    found: Floats = 255.0 * _encoded(np.clip(curve @ _FROM_CURVE.T, 0.0, 1.0))
    return found


def _linear(srgb: Floats) -> Floats:
    found: Floats = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return found


def _encoded(linear: Floats) -> Floats:
    found: Floats = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return found
