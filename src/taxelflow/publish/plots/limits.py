"""Error against the Cramér-Rao bound, by where the object is on the pad."""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING

from taxelflow.publish.plots.style import GREEN, GREY, INK, LOOK, MAGENTA, caption, log_ticks, look

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure

    Curve = Sequence[tuple[float, float]]


def limits_figure(errors: Mapping[str, Curve], bounds: Mapping[str, Curve], edge_mm: float, seen: str) -> Figure:
    """RMS errors and bounds as (position, mm), by method and kind of bound, on a logarithmic scale.

    edge_mm: the pad reaches so far on both sides of 0.
    """
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    others = cycle(((GREEN, "s"), (MAGENTA, "D"), (GREY, "v")))
    for method, curve in errors.items():
        style = look(method)
        if method not in LOOK:
            style["color"], style["marker"] = next(others)
        axis.semilogy(*zip(*curve, strict=True), linewidth=0.8, markersize=3.5, markeredgewidth=0, **style)
    for (name, curve), line in zip(bounds.items(), ("-", "--"), strict=False):
        axis.semilogy(*zip(*curve, strict=True), color=INK, linewidth=1.4, linestyle=line, label=name)
    for side in (-edge_mm, edge_mm):
        axis.axvline(side, color=GREY, linewidth=0.9, linestyle=":")
    axis.set_xlabel("object's centre on the pad in mm")
    axis.set_ylabel("RMS error in mm")
    log_ticks(axis.yaxis)
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    caption(figure, seen)
    return figure
