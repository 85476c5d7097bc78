"""Time plots of one pad or of the object: speed, rate of turn, load, and the slip test against its threshold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.numerics.clock import SAME_S
from taxelflow.publish.view.look import PLOTS

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.history import Results
    from taxelflow.sensors.sensor import Sensor

COUNTS = "counts"
_BLUE, _ORANGE, _GREEN, _GREY = "#4a9fe0", "#e6843c", "#3cb88a", "#8f95a3"


_CIRCLES: Any = {"show": True, "size": 6, "fill": "rgba(0,0,0,0)", "width": 1.2}
_COMPARED = {"speed": 2, "turn": 1}
"""Curves of the plots that differ by method; load and the slip test do not."""


class Chart(NamedTuple):
    """A plot: what stands above it, names and colours of its curves, whether values may be unknown, so that points are
    drawn and no line that joins them, and whether a second method is drawn beside.
    """

    title: str
    curves: tuple[tuple[str, str], ...]
    points: bool = True
    compared: bool = False


def charts(load_unit: str) -> dict[str, Chart]:
    """The plots, from top to bottom."""
    return {
        "speed": Chart(
            f"speed over the last {PLOTS.shown_s:g} s, mm/s (blue x, orange y)",
            (("x", _BLUE), ("y", _ORANGE)),
            compared=True,
        ),
        "turn": Chart("rate of turn, deg/s", (("turn", _GREEN),), compared=True),
        "load": Chart(f"load: sum of all taxels, {load_unit}", (("load", _BLUE),), points=False),
        "test": Chart(
            "slip test, log of statistic over threshold (line: slips above)",
            (("statistic", _ORANGE), ("threshold", _GREY)),
        ),
    }


def shown_unit(sensor: Sensor) -> tuple[float, str]:
    """Factor from conditioned pressure to the unit that is shown, and that unit."""
    return (1.0, COUNTS) if sensor.si_unit == "count" else (1e-3, "kPa")


def load_unit(scale: float, unit: str) -> tuple[float, str]:
    """Factor to the unit of loads, and that unit: millions of counts would fit neither beside an axis nor in a table.

    scale, unit: of pressure.
    """
    return (1e-3 * scale, "thousand counts") if unit == COUNTS else (scale, unit)


class Charts:
    """The plots in the panel. load_scale: from Pa or counts to load_unit. compares: whether a second method is drawn,
    as circles.
    """

    def __init__(self, gui: Any, load_scale: float, load_unit: str, *, compares: bool) -> None:
        self._load_scale, self._compares = load_scale, compares
        self._plots = {name: _plot(gui, chart, compares=compares) for name, chart in charts(load_unit).items()}

    def show(self, results: Results | None, pad: int | None, at_s: float, second: Results | None = None) -> None:
        """Draw results of the last seconds. pad: number; None for the object. second: of a second method."""
        if results is None:
            return
        every = max(1, len(results.slips) // PLOTS.points)
        curves = curves_of(results, pad, self._load_scale)
        others = _beside(second, results.slips.t_s, pad, self._load_scale) if self._compares else {}
        x = (results.slips.t_s - at_s)[::every]
        for name, plot in self._plots.items():
            own = np.array([curve[::every] for curve in (*curves[name], *others.get(name, ()))])
            known = np.isfinite(own).any(axis=0)
            if not others:  # a point whose value is unknown is left out, and no curve has a gap
                known = np.isfinite(own).all(axis=0)
            if plot.visible != bool(known.any()):  # a method may not estimate the turn
                plot.visible = bool(known.any())
            if known.any():
                plot.data = (x[known], *(curve[known] for curve in own))


def curves_of(results: Results, pad: int | None, load_scale: float) -> dict[str, list[Floats]]:
    """Values (scans,) of each curve, by plot, in the units of the titles. pad: None for the object, with all load."""
    slips = results.slips
    if pad is None:
        velocity, load = results.motions.velocity, np.nansum(slips.load, axis=1)
        known = ~np.isnan(results.statistic).all(axis=1)
        tested = np.where(known, np.max(np.nan_to_num(results.statistic, nan=-np.inf), axis=1), np.nan)
    else:
        velocity, load, tested = slips.velocity[:, pad], slips.load[:, pad], results.statistic[:, pad]
    return {
        "speed": [1e3 * velocity[:, 0], 1e3 * velocity[:, 1]],
        "turn": [np.degrees(velocity[:, 2])],
        "load": [load_scale * load],
        "test": [np.log(np.clip(tested, *PLOTS.ratios)), np.zeros(len(slips))],
    }


def _beside(second: Results | None, t_s: Floats, pad: int | None, load_scale: float) -> dict[str, list[Floats]]:
    """Curves of a second method that differ from those of the first, at its times; NaN where there is none."""
    found = {name: [np.full(len(t_s), np.nan) for _ in range(count)] for name, count in _COMPARED.items()}
    if second is None:
        return found
    at = np.clip(np.searchsorted(second.slips.t_s, t_s - SAME_S), 0, len(second.slips) - 1)
    same = np.abs(second.slips.t_s[at] - t_s) < SAME_S
    curves = curves_of(second, pad, load_scale)
    return {name: [np.where(same, curve[at], np.nan) for curve in curves[name]] for name in found}


def _plot(gui: Any, chart: Chart, *, compares: bool) -> Any:
    from viser import uplot

    grid: Any = {"stroke": "rgba(128,134,146,0.25)", "width": 1}
    time = uplot.Axis(stroke=_GREY, grid=grid, ticks=grid | {"size": 3}, size=26, space=48)
    axis = uplot.Axis(stroke=_GREY, grid=grid, ticks=grid | {"size": 3}, size=66, space=22)
    curves = [
        uplot.Series(label=name, stroke=colour, width=width, points={"show": not width, "size": 3.5, "fill": colour})
        for name, colour in chart.curves
        for width in [0.0 if chart.points and name != "threshold" else 1.6]
    ]
    if compares and chart.compared:
        curves += [
            uplot.Series(label=f"{name}, second", stroke=colour, width=0.0, points=_CIRCLES)
            for name, colour in chart.curves
        ]
    nothing = np.array([-PLOTS.shown_s, 0.0])
    return gui.add_uplot(
        data=(nothing, *(np.zeros(2) for _ in curves)),
        series=(uplot.Series(label="s"), *curves),
        title=chart.title,
        scales={"x": uplot.Scale(time=False, range=(-PLOTS.shown_s, 0.0)), "y": uplot.Scale(auto=True)},
        axes=(time, axis),
        legend=uplot.Legend(show=False),
        height=PLOTS.height,
        padding=PLOTS.padding,
    )
