"""Taxels as faces in space: those that face the viewer in colour, those seen from behind pale."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.plots.outlines import outlines
from taxelflow.publish.plots.sizes import FACES
from taxelflow.publish.plots.style import GREY, INK, tick_step

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.pad_geometry import PadGeometry


def faces(layout: Layout, pad: int, own: PadGeometry) -> Floats:
    """(taxels, corners, 3), m, in the frame of the pad's grid or table. own: its geometry there."""
    flat = outlines(layout, pad)
    if not own.table:
        return np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=2)
    off = flat - own.xy[:, np.newaxis]
    thin = np.eye(3)[np.argmin(np.abs(own.normal), axis=1)]
    first = np.cross(own.normal, thin)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(own.normal, first)
    lifted: Floats = (
        own.place_m[:, np.newaxis] + off[..., :1] * first[:, np.newaxis] + off[..., 1:] * second[:, np.newaxis]
    )
    return lifted


def draw_faces(axis: Any, corners: list[Floats], normals: Floats, tints: list[str], *, numbered: bool = False) -> None:
    """Draw taxels on a 3-D axis whose view is set. corners: of each taxel (corners, 3), m. normals: (taxels, 3).

    tints: their colours. numbered: those that face the viewer get their numbers.
    """
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    azimuth, elevation = np.radians(axis.azim), np.radians(axis.elev)
    viewer = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    towards = normals @ viewer
    colours = np.array([to_rgb(tint) for tint in tints])
    share = (FACES.darkest + (0.75 - FACES.darkest) * np.abs(towards))[:, np.newaxis]
    away = 0.9 + FACES.away * (colours - colours.mean(axis=1, keepdims=True))
    shaded = np.where(towards[:, np.newaxis] > 0, share * colours + (1 - share), away.clip(0.0, 1.0))
    skin = Poly3DCollection([1e3 * face for face in corners], facecolors=shaded, edgecolors=GREY, linewidths=0.4)
    axis.add_collection3d(skin)
    for taxel in np.flatnonzero(towards > FACES.readable) if numbered else ():
        x, y, z = 1e3 * corners[taxel].mean(axis=0)
        axis.text(x, y, z, str(taxel), fontsize=7, color=INK, ha="center", va="center")


def frame(axis: Any, places: Floats, azimuth_deg: float, elevation_deg: float) -> None:
    """Show the places (n, 3) in m with equal scales, from this direction, and a few ticks that do not meet."""
    from matplotlib.ticker import MultipleLocator

    low, high = 1e3 * places.min(axis=0), 1e3 * places.max(axis=0)
    largest = float((high - low).max())
    half = np.maximum(high - low, FACES.thinnest * largest) / 2 * 1.05
    middle = (low + high) / 2
    for number, letter in enumerate("xyz"):
        getattr(axis, f"set_{letter}lim")(middle[number] - half[number], middle[number] + half[number])
        step = max(tick_step(2 * half[number], 6), tick_step(largest, 8))
        getattr(axis, f"{letter}axis").set_major_locator(MultipleLocator(step))
        getattr(axis, f"set_{letter}label")(
            f"{letter} in mm", fontsize=8, labelpad=2 if half[number] > 0.15 * largest else -5
        )
    axis.tick_params(labelsize=7, pad=0)
    axis.set_box_aspect(half, zoom=0.95)
    axis.view_init(elev=elevation_deg, azim=azimuth_deg)


def on_paper(axis: Any, places: Floats) -> Floats:
    """(n, 2): places (n, 3) in m in the 2-D data coordinates of a 3-D axis."""
    from mpl_toolkits.mplot3d import proj3d

    x, y, _ = proj3d.proj_transform(*(1e3 * places.T), axis.get_proj())
    return np.column_stack([x, y])
