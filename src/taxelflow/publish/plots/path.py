"""The object's path on each pad, drawn on the pad's taxels; many contacts in a panel each."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.spans import spans
from taxelflow.publish.plots.marks import draw_taxels, show_box
from taxelflow.publish.plots.outlines import extent_mm, outlines
from taxelflow.publish.plots.sizes import POSITION
from taxelflow.publish.plots.style import BLUE, FAINT, GREY, INK, VERMILION, caption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Bools, Floats
    from taxelflow.publish.plots.marks import Box
    from taxelflow.publish.results import Track
    from taxelflow.sensors.layout import Layout


def path_figure(tracks: Sequence[Track], layout: Layout, most_overlaid: int = 6) -> Figure:
    """Tracks of one method on their pads; with more contacts on one pad than a panel can show, a panel for each.

    Contacts of fewer than three known positions have no path.
    """
    contacts = [_Contact(track, first, stop) for track in tracks for first, stop in spans(track.flags["contact"])]
    contacts = [contact for contact in contacts if np.isfinite(contact.at_mm[:, 0]).sum() >= 3]
    crowd = max((sum(contact.track is track for contact in contacts) for track in tracks), default=0)
    return _panels(contacts, layout) if crowd > most_overlaid else _overlaid(tracks, layout)


class _Contact:
    """One contact of a track. at_mm: (n, 2). slipping, ok: (n,). path_mm: length of its path while slipping."""

    def __init__(self, track: Track, first: int, stop: int) -> None:
        self.track = track
        self.t_s = track.numbers["t_s"][first:stop]
        self.at_mm = 1e3 * track.position_m[first:stop]
        self.slipping, self.ok = track.flags["slipping"][first:stop], track.flags["ok"][first:stop]
        steps = np.hypot(*np.diff(self.at_mm, axis=0).T)
        self.path_mm = float(np.nansum(steps[self.slipping[1:]]))


def _panels(contacts: Sequence[_Contact], layout: Layout, most: int = 60, across: int = 10) -> Figure:
    """A panel for each contact, on one scale, in the order of time; those with the longest slips if they are many."""
    import matplotlib.pyplot as plt
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgba_array

    chosen = heapq.nlargest(most, contacts, key=lambda contact: contact.path_mm)
    chosen.sort(key=lambda contact: float(contact.t_s[0]))
    start_s = min(float(contact.track.numbers["t_s"][0]) for contact in chosen)
    widest = max(np.ptp(extent_mm(layout, layout.pads.index(contact.track.pad))[:2]) for contact in chosen)
    boxes = [_box_mm(layout, contact.track.pad, contact.at_mm) for contact in chosen]
    wide, high = max(box[1] - box[0] for box in boxes), max(box[3] - box[2] for box in boxes)
    cols = min(across, len(chosen))
    rows = -(-len(chosen) // cols)
    width = 10.5 / cols
    height = float(np.clip(width * high / wide, 0.5, 2.2)) + 0.34
    figure, axes = plt.subplots(rows, cols, squeeze=False, figsize=(10.5, rows * height + 0.7), layout="constrained")
    for axis in axes.flat[len(chosen) :]:
        axis.axis("off")
    for axis, contact, (left, right, low, top) in zip(axes.flat, chosen, boxes, strict=False):
        draw_pad(axis, layout, layout.pads.index(contact.track.pad))
        at, slipping = contact.at_mm, contact.slipping
        lines = np.stack([at[:-1], at[1:]], axis=1)
        colours = to_rgba_array(np.where(slipping[1:], VERMILION, GREY).tolist())
        colours[:, 3] = np.where(contact.ok[:-1] & contact.ok[1:], 1.0, POSITION.doubted)
        axis.add_collection(LineCollection(list(lines), colors=colours, linewidths=1.3, zorder=3))
        known = np.flatnonzero(np.isfinite(at[:, 0]))
        axis.plot(*at[known[0]], marker="o", markersize=3.2, color=BLUE, zorder=4)
        axis.plot(*at[known[-1]], marker="s", markersize=3.2, color=INK, zorder=4)
        axis.set_xlim((left + right - 1.1 * wide) / 2, (left + right + 1.1 * wide) / 2)
        axis.set_ylim((low + top - 1.1 * high) / 2, (low + top + 1.1 * high) / 2)
        axis.set_axis_off()
        title = f"{contact.t_s[0] - start_s:.1f} s  {contact.path_mm:.0f} mm"
        axis.set_title(f"{contact.track.pad}\n{title}", fontsize=6.5, fontweight="normal", pad=2)
    few = len(chosen) < len(contacts)
    count = (
        f"The {len(chosen)} of {len(contacts)} contacts that slip farthest" if few else f"All {len(chosen)} contacts"
    )
    text = (
        f"{count}, with start time and length of path while slipping. Blue dot: first position; black square: last; "
        f"orange: slip{_words([contact.ok for contact in chosen])}. All pads have one scale; the widest is "
        f"{widest:.0f} mm."
    )
    caption(figure, text)
    return figure


def _overlaid(tracks: Sequence[Track], layout: Layout) -> Figure:
    """Tracks each on its own pad; colour is time, larger dots are slip."""
    import matplotlib.pyplot as plt

    boxes = [_box_mm(layout, track.pad, 1e3 * track.position_m) for track in tracks]
    ratios = [(right - left) / (high - low) for left, right, low, high in boxes]
    height = min(4.4, 8.0 / sum(ratios))
    figure, axes = plt.subplots(
        1,
        len(tracks),
        squeeze=False,
        figsize=(1.9 + height * sum(ratios) + 0.5 * len(tracks), height + 0.9),
        width_ratios=ratios,
        layout="constrained",
    )
    start_s = min(float(track.numbers["t_s"][0]) for track in tracks)
    end_s = max(float(track.numbers["t_s"][-1]) for track in tracks) - start_s
    dots = None
    for axis, track, (left, right, low, high) in zip(axes[0], tracks, boxes, strict=True):
        draw_pad(axis, layout, layout.pads.index(track.pad))
        axis.set_xlim(left, right)
        axis.set_ylim(low, high)
        at_mm, slipping = 1e3 * track.position_m, track.flags["slipping"]
        axis.plot(at_mm[:, 0], at_mm[:, 1], color=GREY, linewidth=0.5, zorder=2)
        dots = axis.scatter(
            at_mm[:, 0],
            at_mm[:, 1],
            c=track.t_s - start_s,
            s=np.where(slipping, 16.0, 4.0),
            alpha=np.where(track.flags["ok"], 1.0, POSITION.doubted),
            cmap="viridis",
            vmin=0.0,
            vmax=end_s,
            linewidths=0,
            zorder=3,
        )
        axis.set_title(track.pad)
        axis.set_xlabel("x in mm")
    axes[0, 0].set_ylabel("y in mm")
    if dots is not None:
        figure.colorbar(dots, ax=axes[0, -1], label="time in s", shrink=0.8)
    sure = _words([track.flags["ok"] | np.isnan(track.position_m[:, 0]) for track in tracks])
    caption(figure, f"Path of the object on the pad; large dots: slip{sure}.")
    return figure


def _words(ok: Sequence[Bools]) -> str:
    """What faint parts are, if there are any."""
    return "" if all(one.all() for one in ok) else "; faint: quality not ok"


def _box_mm(layout: Layout, pad: str, at_mm: Floats) -> Box:
    """The pad and the way (n, 2) on it, which may lead half a pad beyond it and is cut there."""
    left, right, low, high = extent_mm(layout, layout.pads.index(pad))
    wide, tall = (right - left) / 2, (high - low) / 2
    at_mm = at_mm[np.isfinite(at_mm).all(axis=1)]
    if not len(at_mm):
        return left, right, low, high
    margin = 0.02 * max(wide, tall)
    x = np.clip([at_mm[:, 0].min() - margin, at_mm[:, 0].max() + margin], left - wide, right + wide)
    y = np.clip([at_mm[:, 1].min() - margin, at_mm[:, 1].max() + margin], low - tall, high + tall)
    return min(left, float(x[0])), max(right, float(x[1])), min(low, float(y[0])), max(high, float(y[1]))


def draw_pad(axis: Axes, layout: Layout, pad: int) -> None:
    """Taxels of a pad, faint, in mm, row 0 on top."""
    draw_taxels(axis, 1e3 * outlines(layout, pad), facecolor=FAINT, linewidth=0.6)
    show_box(axis, extent_mm(layout, pad))
    axis.tick_params(colors=INK)
