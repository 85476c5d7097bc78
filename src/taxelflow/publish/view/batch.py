"""One mesh that stands for many equal shapes, so that an update is a few messages whatever their number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view.shapes import NONE

if TYPE_CHECKING:
    from taxelflow.publish.view.shapes import Shape


def add_batch(server: Any, name: str, shape: Shape, count: int, **more: Any) -> Any:
    """viser's handle. more: wxyzs (count, 4), positions and scales (count, 3), and what viser takes.

    Add what has nothing to show yet with visible=False: what is drawn for the first time costs a browser without a GPU
    a tenth of a second, however small it is.
    """
    return server.scene.add_batched_meshes_simple(
        name,
        shape.vertices,
        shape.faces,
        batched_wxyzs=more.pop("wxyzs", np.tile((1.0, 0.0, 0.0, 0.0), (count, 1))),
        batched_positions=more.pop("positions", np.zeros((count, 3))),
        batched_scales=more.pop("scales", np.full((count, 3), NONE)),
        batched_colors=np.zeros((count, 3), dtype=np.uint8),
        lod="off",
        cast_shadow=False,
        receive_shadow=False,
        **more,
    )


def put(handle: Any, **arrays: Any) -> None:
    """Set arrays of a handle, but those that are as they were: viser would send them again."""
    for name, array in arrays.items():
        held = getattr(handle, name)
        if not (held.shape == array.shape and np.array_equal(held, array.astype(held.dtype))):
            setattr(handle, name, array)
