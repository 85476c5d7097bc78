"""One scan in the paper's three views (Fig. 5): raw pressure, convolution, slip vector."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.publish.plots.marks import draw_arrow
from taxelflow.publish.plots.style import GREY, INK, MAGENTA, VERMILION, tick_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Floats


def views_figure(title: str, pressure: Floats, unit: str, convolution: Floats, slip_mm: tuple[float, float]) -> Figure:
    """pressure: (rows, cols), NaN where no taxel is, row 0 on top. convolution: (2 rows - 1, 2 cols - 1).

    slip_mm: (dx, dy) of one scan in the pad's frame.
    """
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(10.5, 3.9))
    figure.suptitle(title, x=0.02, ha="left", fontweight="bold")
    _draw_bars(figure.add_axes((0.0, 0.0, 0.36, 0.88), projection="3d"), pressure)
    _draw_convolution(figure.add_axes((0.43, 0.13, 0.24, 0.68)), convolution)
    _draw_vector(figure.add_axes((0.71, 0.11, 0.27, 0.70)), slip_mm)
    headings = (
        f"pressure in {unit}, maximum in magenta",
        "convolution C[T]",
        f"slip, {np.hypot(*slip_mm):.2f} mm a scan",
    )
    for left, heading in zip((0.06, 0.43, 0.74), headings, strict=True):
        figure.text(left, 0.885, heading, fontsize=9, color=INK)
    return figure


def _draw_bars(axis: Axes, pressure: Floats) -> None:
    from matplotlib.ticker import MaxNLocator

    rows, cols = pressure.shape
    row, col = np.nonzero(np.isfinite(pressure))
    height = np.clip(pressure[row, col], 0.0, None)
    colours = np.full(len(height), "#aecbeb", dtype=object)
    colours[int(np.argmax(height))] = MAGENTA
    axis.bar3d(  # type: ignore[attr-defined]  # a 3-D axis
        col - 0.45, row - 0.45, 0.0, 0.9, 0.9, height, color=colours.tolist(), edgecolor="#5f6368", linewidth=0.3
    )
    axis.set_xlabel("column")
    axis.set_ylabel("row", labelpad=8.0)
    axis.set_xlim(-0.5, cols - 0.5)
    axis.set_ylim(rows - 0.5, -0.5)
    axis.set_xticks(range(0, cols, 1 if cols < 10 else 4))
    axis.set_yticks(range(0, rows, 1 if rows < 10 else 4))
    axis.zaxis.set_major_locator(MaxNLocator(5))  # type: ignore[attr-defined]
    axis.set_box_aspect((cols, rows, 0.7 * max(rows, cols)), zoom=0.86)  # type: ignore[call-arg, arg-type]
    axis.view_init(elev=32, azim=-62)  # type: ignore[attr-defined]


def _draw_convolution(axis: Axes, convolution: Floats) -> None:
    from matplotlib.ticker import MaxNLocator

    height, width = convolution.shape
    axis.imshow(convolution, cmap="viridis", extent=(0.5, width + 0.5, height + 0.5, 0.5), interpolation="nearest")
    axis.set_xlabel("i")
    axis.set_ylabel("j")
    total = float(convolution.sum())
    if total > 0:
        i = float(np.arange(1, width + 1) @ convolution.sum(axis=0) / total)
        j = float(np.arange(1, height + 1) @ convolution.sum(axis=1) / total)
        axis.plot([i], [j], marker="+", markersize=13, markeredgewidth=2, color="white")
        axis.set_xlabel(f"i   (centroid {i:.2f})")
        axis.set_ylabel(f"j   (centroid {j:.2f})")
    for one in (axis.xaxis, axis.yaxis):
        one.set_major_locator(MaxNLocator(7, integer=True))
    axis.grid(visible=False)


def _draw_vector(axis: Axes, slip_mm: tuple[float, float]) -> None:
    size = float(np.hypot(*slip_mm))
    outer = 3 * tick_step(max(size, 0.03), 3)  # so that three rings have round radii
    across = -np.sign(slip_mm[1] or 1.0) * np.sqrt(0.5)  # numbers stand where the arrow does not
    for share in (1 / 3, 2 / 3, 1.0):
        ring = outer * share
        angle = np.linspace(0, 2 * np.pi, 181)
        axis.plot(ring * np.cos(angle), ring * np.sin(angle), color=GREY, linewidth=0.7)
        unit = " mm" if share == 1.0 else ""
        axis.annotate(
            f"{ring:.3g}{unit}", (np.sqrt(0.5) * ring, across * ring), ha="left", fontsize=7, color=INK,
            va="top" if across < 0 else "bottom",
        )  # fmt: skip
    axis.plot([-outer, outer], [0, 0], color=GREY, linewidth=0.4)
    axis.plot([0, 0], [-outer, outer], color=GREY, linewidth=0.4)
    if size > 0:
        draw_arrow(axis, (0, 0), slip_mm, VERMILION, 2.2)
    axis.set_xlim(-1.15 * outer, 1.15 * outer)
    axis.set_ylim(-1.15 * outer, 1.15 * outer)
    axis.set_aspect("equal")
    axis.grid(visible=False)
    axis.axis("off")
