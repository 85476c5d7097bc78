"""The links of a hand with joints: solids between its joints, behind its pads.

The model of a hand has the places of joints, but no surfaces of links. Each link is drawn as the convex hull of its
joints and of the backs of its pads. It lies behind its own pads, and hides none of their taxels from the front.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.publish.view import shapes
from taxelflow.publish.view.batch import add_batch, put
from taxelflow.publish.view.look import LINKS

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.shapes import Shape


class Skin(NamedTuple):
    """Taxels of the pads on one link, in its frame. place, normal: (n, 3). across: (n, 3, 2), to its neighbours, m."""

    place: Floats
    normal: Floats
    across: Floats


class HandLinks:
    """The solids. They move with the fingers."""

    def __init__(self, server: Any, links: dict[int, tuple[Floats, Skin]], size_m: float) -> None:
        """links: joints and skin of each link by its number, see `Fingers`."""
        found = [(link, solid_of(ends, skin, LINKS.joint * size_m)) for link, (ends, skin) in links.items()]
        self._shapes = {link: shape for link, shape in found if shape is not None}
        self._T: dict[int, Floats] = {}
        self._solids = [
            (link, add_batch(server, f"/hand/{link}", shape, 1, scales=np.ones((1, 3)), opacity=LINKS.opacity))
            for link, shape in self._shapes.items()
        ]

    def move(self, T: dict[int, Floats]) -> None:
        """Put the links where they are: poses (4, 4) in the hand."""
        self._T = T
        for link, solid in self._solids:
            frame = T[link]
            turned = shapes.along(frame[:3, 2][np.newaxis], frame[:3, 0][np.newaxis])
            put(solid, batched_positions=frame[:3, 3][np.newaxis], batched_wxyzs=turned)

    def corners(self) -> Floats:
        """(n, 3), of all links where they are now."""
        places = [
            shape.vertices @ self._T[link][:3, :3].T + self._T[link][:3, 3] for link, shape in self._shapes.items()
        ]
        return np.concatenate(places)

    def tint(self, colour: Any) -> None:
        """colour: (3,)."""
        for _, solid in self._solids:
            put(solid, batched_colors=colour[np.newaxis])


def solid_of(ends: Floats, skin: Skin, joint_m: float) -> Shape | None:
    """A link in its frame; None where it has no extent. ends: (n, 2, 3), places and axes of its joints, see
    `Kinematics.ends`. joint_m: radius of a joint at most.
    """
    import trimesh

    back = _back(skin)
    flesh = 0.35 * back.mean(axis=0) + 0.65 * back - 0.8 * joint_m * skin.normal.mean(axis=0) if len(back) else back
    foot = _flange(ends) if not ends[0].any() else _joint(ends[0], skin, joint_m)
    points = [back, flesh, foot, *(_joint(end, skin, joint_m) for end in ends[1:])]
    cloud = np.concatenate(points)
    for place, normal, across in zip(*skin, strict=True):
        above = (cloud - place) @ normal + LINKS.behind * np.linalg.norm(across, axis=0).max()
        cloud = cloud - np.maximum(above, 0.0)[:, np.newaxis] * normal
    if len(cloud) < 4 or np.linalg.svd(cloud - cloud.mean(axis=0), compute_uv=False)[-1] < 1e-3 * joint_m:
        return None
    hull = trimesh.convex.convex_hull(cloud)
    return shapes.Shape(np.asarray(hull.vertices), np.asarray(hull.faces))


def _back(skin: Skin) -> Floats:
    """(n, 3), outline of the pads, behind them."""
    pitch = np.linalg.norm(skin.across, axis=1).max(axis=1)[:, np.newaxis] if len(skin.place) else np.zeros((0, 1))
    inner = skin.place - LINKS.behind * pitch * skin.normal
    corners = [
        inner + LINKS.rim * (a * skin.across[..., 0] + b * skin.across[..., 1]) for a in (-1, 1) for b in (-1, 1)
    ]
    return np.concatenate(corners)


def _flange(ends: Floats) -> Floats:
    """(n, 3), where the hand is mounted: a disc at the origin, across the way to its joints, half as wide as they."""
    way = ends[1:, 0].mean(axis=0) if len(ends) > 1 else np.zeros(3)
    if not way.any():
        return np.zeros((1, 3))
    along = way / np.linalg.norm(way)
    aside = ends[1:, 0] - np.outer(ends[1:, 0] @ along, along)
    return _ring(along, 0.6 * float(np.linalg.norm(aside, axis=1).max()))


def _ring(axis: Floats, radius: float) -> Floats:
    """(n, 3), a circle about an axis (3,) through the origin."""
    turn = 2 * np.pi * np.arange(LINKS.sections) / LINKS.sections
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    found: Floats = radius * (np.outer(np.cos(turn), first) + np.outer(np.sin(turn), np.cross(axis, first)))
    return found


def _joint(end: Floats, skin: Skin, joint_m: float) -> Floats:
    """(n, 3), a cylinder about a joint's axis, or a ball; thinner where a pad is near."""
    place, axis = end
    below = -((place - skin.place) * skin.normal).sum(axis=1)
    radius = joint_m if not len(below) or below.min() < 0.3 * joint_m else min(joint_m, 0.9 * float(below.min()))
    if not axis.any():
        grid = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
        grid = grid[grid.any(axis=1)]
        ball: Floats = place + radius * grid / np.linalg.norm(grid, axis=1, keepdims=True)
        return ball
    ring = _ring(axis, radius)
    reach = float(np.abs((skin.place - place) @ axis).max()) if len(skin.place) else radius
    half = min(max(reach, radius), 1.3 * joint_m) * axis
    found: Floats = np.concatenate([place + ring - half, place + ring + half])
    return found
