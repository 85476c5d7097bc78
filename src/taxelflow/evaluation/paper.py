"""The paper's figures and Table I, drawn from the rig."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.centroid.paper_reference import convolution_matrix
from taxelflow.evaluation.base import Watch
from taxelflow.evaluation.field import Field, true_twist
from taxelflow.evaluation.limits import Limits
from taxelflow.evaluation.strokes import PAPER_METHODS, Row
from taxelflow.evaluation.table1 import PaperRow, Table1
from taxelflow.messages import OK
from taxelflow.pipeline import api
from taxelflow.publish.figures import strokes_of
from taxelflow.publish.plots.curve import curve_figure, table_figure
from taxelflow.publish.plots.hand import Moment, at_contacts, field_figure, layout_figure
from taxelflow.publish.plots.limits import limits_figure
from taxelflow.publish.plots.position import position_figure
from taxelflow.publish.plots.style import look, save, styled
from taxelflow.publish.plots.views import views_figure
from taxelflow.publish.results import Track
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.figure import Figure

    from taxelflow.acquire.base import Recording, Truth

FIELD_METHODS = ("convolution", "template")
"""Methods whose slip vectors stand one above the other in Fig. 4 and 7."""
_HAND = "barretthand-162"


def draw_paper(out: Path, form: str, *, strokes: int, seeds: int, watched: Watch) -> list[Path]:
    """Draw every figure into `out`, made if need be. Raises ExtraMissing.

    strokes: per speed in Table I. seeds: per scenario in the curves of rotation error and of error against the bound.
    """
    figures: dict[str, Callable[[], Figure]] = {
        "fig2-taxels": _taxels,
        "fig4-bulb": _bulb,
        "fig5-views": _views,
        "fig6-frames": _frames,
        "fig7-rotation": _rotation,
        **({"spread-field": _spread_field} if find_spec("mujoco") else {}),  # of extra sim
        "fig9-position": _position,
        "table1": lambda: _table1(strokes, watched),
        "rotation-by-vectors": lambda: _curve(seeds, watched),
        "error-over-position": lambda: _limits(seeds, watched),
    }
    with styled():
        return [save(draw(), out / f"{name}.{form}") for name, draw in figures.items()]


def _taxels() -> Figure:
    caption = (
        "The 162 taxels of the paper's hand, numbered as in a scan, on the hand laid flat. The palm's second row is "
        "143 to 149, as in the paper; the order within the fingers, the tips' shape and the fingers' places are "
        "assumptions."
    )
    return layout_figure(load_sensor(_HAND).layout, caption, numbers=True)


def _frames() -> Figure:
    caption = (
        "Frames on the hand laid flat: x of each pad in orange, y in blue. The palm's frame is the hand's (the paper's "
        "Fig. 6). Groups of the palm, in magenta, have slip vectors of their own."
    )
    return layout_figure(load_sensor(_HAND).layout, caption, numbers=False)


def _bulb() -> Figure:
    recording = simulate(SCENARIOS["bulb-pull"])
    moving = _moving_times(recording.known_truth)
    times = [moving[0] + share * (moving[1] - moving[0]) for share in (0.25, 0.5, 0.75)]
    caption = (
        "A compliant bulb pulled from left to right over the hand (the paper's Fig. 4), at three times: taxels shaded "
        "by pressure, slip vectors of pads and palm groups in orange. Those of Method II fall far short of the pull: "
        "the bulb covers whole pads, and the centroid of a full pad hardly moves. Those of the "
        "template are close to it where a pad sees enough of the bulb's texture, and err where it does not."
    )
    return field_figure(recording.layout, _by_method(recording, times), caption)


def _rotation() -> Figure:
    turn, both = (simulate(SCENARIOS[name]) for name in ("turn-over-hand", "slide-and-turn-over-hand"))
    first, last = _moving_times(turn.known_truth)
    fields = _by_method(turn, [first + 0.25 * (last - first), first + 0.75 * (last - first)])
    first, last = _moving_times(both.known_truth)
    for name, moments in _by_method(both, [first + 0.25 * (last - first)]).items():
        fields[name] += moments
    caption = (
        "An object turned over the hand, there and back, and turned while it slides (the paper's Fig. 7): slip vectors "
        "in orange, the centre of rotation as a magenta cross where it is sure. Fingers 1 and 2 give opposite vectors, "
        "the palm's left and right groups mirror them. Blue: the palm as one group, whose vector is nearly empty "
        "while the object turns about it."
    )
    return field_figure(turn.layout, fields, caption)


def _views() -> Figure:
    scenario = SCENARIOS["stroke"]
    scenario = replace(
        scenario,
        pad="finger1_mid",
        contact=replace(scenario.contact, radius_m=0.008),
        motion=replace(scenario.motion, travel_m=0.06, middle_m=(0.0, 0.0), direction_rad=float(np.pi / 4)),
    )
    recording = simulate(scenario)
    pad = recording.layout.pads.index(scenario.pad)
    result, scans = api.estimate(recording), api.conditioned(recording).pressure
    scan = int(np.nanargmin(np.hypot(*result.slips.pose[:, pad, :2].T)))  # nearest to the middle
    before, now = (recording.layout.grid(pad, scans[k]) for k in (scan - 1, scan))
    dx, dy = (1e3 * float(step) for step in result.slips.displacement[scan, pad, :2])
    title = "A mid phalange, 6 x 4 taxels, under a small airbag that slides diagonally"
    return views_figure(title, now / 1e3, "kPa", convolution_matrix(before, now), (dx, dy))


def _position() -> Figure:
    recording = simulate(SCENARIOS["stroke"])
    truth = recording.known_truth
    pad = recording.layout.pads.index(truth.pad)
    tracks = [_track(recording, method, pad) for method in ("lnorm", "convolution")]
    return position_figure(tracks, (truth.t_s, truth.pose[:, :2]), strokes_of(truth.t_s, truth.pose))


def _table1(strokes: int, watched: Watch) -> Figure:
    scored = Table1(strokes, methods=PAPER_METHODS).run(watched)
    names = {"lnorm": "L norm", "convolution": "optical flow"}
    scored_rows: list[tuple[Row | PaperRow, str, str, int]] = [
        (row, "paper, one trial", "10.5 mm", 1) for row in scored.paper
    ]
    scored_rows += [(row, row.scans, "none" if row.factor == 1.0 else f"{row.factor:.3f}", 2) for row in scored.ours]
    rows = [
        (
            str(row.nominal_mm_s),
            names.get(row.method, row.method),
            scans,
            factor if row.method == "convolution" or digits == 2 else "none",
            *(f"{value:.2f}" for value in (row.backward_mm_s, row.forward_mm_s, row.rmse_mm_s)),
            f"{row.rmse_percent:.{digits}f}",
        )
        for row, scans, factor, digits in scored_rows
    ]
    headings = ("mm/s", "method", "scans", "factor", "backward", "forward", "RMSE mm/s", "RMSE %")
    caption = (
        f"Table I: the paper's rows, and {strokes} strokes a speed on the rig. The 10.5 mm is of the optical flow only."
    )
    return table_figure(headings, rows, caption)


def _some(seeds: int) -> str:
    """The number of seeds, in words of a caption."""
    return "1 seed" if seeds == 1 else f"{seeds} seeds"


def _curve(seeds: int, watched: Watch) -> Figure:
    curves: dict[str, list[tuple[int, float]]] = {}
    for row in Field(seeds).run(watched).rows:
        curves.setdefault(row.scenario, []).append((row.vectors, row.turn_percent))
    caption = (
        f"Error of the rate of turn by number of slip vectors, {_some(seeds)} a scenario (taxelflow score field). Four "
        "are better than two; more do not help here, because what is left is the centroid's bias and not noise."
    )
    return curve_figure(curves, "RMSE of the rate of turn in %", caption)


def _limits(seeds: int, watched: Watch) -> Figure:
    scored = Limits(seeds=seeds).run(watched)
    errors: dict[str, list[tuple[float, float]]] = {}
    known: dict[float, float] = {}
    unknown: dict[float, float] = {}
    for row in scored.places:
        errors.setdefault(row.method, []).append((row.at_mm, row.error_mm))
        known.setdefault(row.at_mm, row.known_mm)
        if row.unknown_mm is not None:
            unknown.setdefault(row.at_mm, row.unknown_mm)
    palm = load_sensor(_HAND).layout
    edge_mm = 1e3 * float(np.max(palm.x_m[palm.of_pad(palm.pads.index("palm"))]) + palm.pitch_m[-1, 0] / 2)
    caption = (
        f"Error of an airbag's position along its stroke over the palm, by where it is, {_some(seeds)} (taxelflow "
        "score limits), against the Cramér-Rao bound; dotted: the palm's edge. Centroids are biased as soon as the "
        "edge cuts the contact. The template is at the bound; far out it is below, for it knows that the gain hardly "
        "changes."
    )
    bounds = {"bound, pattern known": known, "bound, pattern unknown": unknown}
    return limits_figure(errors, {name: sorted(own.items()) for name, own in bounds.items() if own}, edge_mm, caption)


def _by_method(recording: Recording, times_s: list[float]) -> dict[str, list[Moment]]:
    """The fields of each of `FIELD_METHODS` at these times."""
    return {look(method)["label"]: _moments(recording, method, times_s) for method in FIELD_METHODS}


def _moments(recording: Recording, method: str, times_s: list[float]) -> list[Moment]:
    """The field of a method at these times, with the truth's twist over the same scans."""
    result, pressure = api.estimate(recording, method), api.conditioned(recording).pressure
    layout, slips, motions = recording.layout, result.slips, result.motions
    moments = []
    for t_s in times_s:
        k = int(np.searchsorted(slips.t_s, t_s))
        places, vectors = at_contacts(layout, slips.pose[k], slips.velocity[k], pressure[k])
        places[~slips.valid[k]] = vectors[~slips.valid[k]] = np.nan
        lag = round(float(np.nanmax(slips.span_s[k]) / (slips.t_s[k] - slips.t_s[k - 1])))
        true = true_twist(recording.known_truth, slips.t_s[k - lag : k - lag + 1], slips.t_s[k : k + 1])[0]
        title, whole = f"{slips.t_s[k] - slips.t_s[0]:.2f} s", ~layout.independent
        moments.append(
            Moment(title, places, vectors, motions.velocity[k], motions.centre[k], pressure[k], true, whole=whole)
        )
    return moments


def _track(recording: Recording, method: str, pad: int) -> Track:
    result = api.estimate(recording, method)
    slips = result.slips
    std = np.sqrt(np.diagonal(slips.covariance[:, pad], axis1=1, axis2=2))
    numbers = {
        "t_s": slips.t_s,
        "x_m": slips.pose[:, pad, 0],
        "y_m": slips.pose[:, pad, 1],
        "std_x_m": std[:, 0],
        "std_y_m": std[:, 1],
        "lag_s": slips.lag_s[:, pad],
        "load_pa": slips.load[:, pad],
    }
    flags = {
        "contact": slips.contact[:, pad],
        "slipping": result.slipping[:, pad],
        "ok": slips.quality[:, pad] == OK,
    }
    return Track(method, recording.layout.pads[pad], numbers, flags)


def _moving_times(truth: Truth) -> tuple[float, float]:
    """When the object first and last moves."""
    moves = np.flatnonzero(np.abs(np.diff(truth.pose, axis=0)).max(axis=1) > 1e-9)
    return float(truth.t_s[moves[0]]), float(truth.t_s[moves[-1]])


def _spread_field() -> Figure:
    """The field of slip vectors in a spread grasp, in space and on the map, with rotor and the spatial solution."""
    from taxelflow.publish.plots.space import SpaceField, in_space, rotor_on_map, space_figure
    from taxelflow.sensors.kinematics import PadKinematics
    from taxelflow.simulation.grasp import Grasp, simulate_grasp

    grasped = simulate_grasp(Grasp(strokes=2))
    result = api.estimate(grasped.recording, "template")
    spatial, slips, k = result.spatial, result.slips, grasped.strokes[0].stop - 1
    if spatial is None:
        raise RuntimeError("a simulated grasp has joint angles")
    first = k - round(0.25 * 100)
    sensor = grasped.recording.sensor
    T = PadKinematics(sensor).poses(PadKinematics(sensor).angles_at(grasped.recording.joints, slips.t_s[[first, k]]))
    pads = len(sensor.pads)
    flat = np.concatenate([slips.pose[[first, k], :pads, :2], np.zeros((2, pads, 1))], axis=2)
    places = np.einsum("kpij,kpj->kpi", T[..., :3, :3], flat) + T[..., :3, 3]
    vectors = (places[1] - places[0]) / (slips.t_s[k] - slips.t_s[first])
    hand = in_space(sensor, "spread")
    field = SpaceField(places[1], vectors, "")
    v, omega = 1e3 * spatial.twist[k][:3], np.degrees(spatial.twist[k][3:])
    words = (
        f"Template, window of 0.25 s. Rotor on the map {rotor_on_map(hand, field):+.2f} 1/s. Solution in space: "
        f"v = ({v[0]:+.1f}, {v[1]:+.1f}, {v[2]:+.1f}) mm/s, omega = ({omega[0]:+.1f}, {omega[1]:+.1f}, "
        f"{omega[2]:+.1f}) deg/s, rank {spatial.rank[k]}; true: v = (0, 0, 25) mm/s, omega = (0, 0, 30) deg/s."
    )
    return space_figure(hand, replace(field, words=words), "spread grasp")
