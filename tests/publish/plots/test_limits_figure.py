from __future__ import annotations

from taxelflow.publish.plots.limits import limits_figure
from taxelflow.publish.plots.style import styled


def test_each_method_and_each_bound_is_a_line_of_its_own() -> None:
    errors = {name: [(-10.0, 5.0), (0.0, 0.5), (10.0, 5.0)] for name in ("lnorm", "convolution", "mine", "yours")}
    bounds = {"known": [(-10.0, 0.2), (10.0, 0.2)], "unknown": [(-10.0, 0.3), (10.0, 0.3)]}
    with styled():
        figure = limits_figure(errors, bounds, 35.0, "what is seen")
        (axis,) = figure.axes
        named = {str(line.get_label()): line for line in axis.get_lines() if not str(line.get_label()).startswith("_")}
        edges = [line.get_xdata()[0] for line in axis.get_lines() if str(line.get_label()).startswith("_")]
    assert list(named) == ["L norm (Method I)", "optical flow (Method II)", "mine", "yours", "known", "unknown"]
    assert len({(line.get_color(), line.get_marker(), line.get_linestyle()) for line in named.values()}) == 6
    assert list(named["mine"].get_ydata()) == [5.0, 0.5, 5.0]
    assert edges == [-35.0, 35.0]
    assert axis.get_yscale() == "log"
