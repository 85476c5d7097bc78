"""One look for all pictures: colours that colour-blind people can distinguish, quiet axes, methods by mark."""

from __future__ import annotations

import math
import textwrap
import warnings
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taxelflow.errors import ExtraMissing
from taxelflow.runtime.whole_file import whole_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from matplotlib.figure import Figure

_SHEET = Path(__file__).with_name("pictures.mplstyle")

BLUE, VERMILION, GREEN, MAGENTA, GREY, INK = "#0072b2", "#d55e00", "#009e73", "#cc2fa0", "#9aa0a6", "#202124"
"""Okabe and Ito's colours; the paper marks its maximum in magenta."""

TINTS = (BLUE, GREEN, MAGENTA, "#e69f00", "#56b4e9", VERMILION)
"""Of things that have no order, such as pads."""

SLIP, FAINT, EDGE, UNSEEN = "#fdeccd", "#f1f3f4", "#dadce0", "#26262c"
"""Shade behind a slip; taxels without pressure, and their outlines; what no taxel observed of a pattern."""

LOOK = {
    "lnorm": {"label": "L norm (Method I)", "color": BLUE, "marker": "o"},
    "convolution": {"label": "optical flow (Method II)", "color": VERMILION, "marker": "^"},
}
"""As in the paper's Fig. 9: the L norm as blue dots, the optical flow as red triangles."""

_OTHERS = ((BLUE, "o"), (GREEN, "s"), (MAGENTA, "D"), ("#8a6d00", "v"), ("#56b4e9", "P"), (VERMILION, "^"), (GREY, "X"))
"""Colours and markers of results whose own are taken."""


def look(method: str) -> dict[str, Any]:
    """Label, colour and marker of a method."""
    return LOOK.get(method, {"label": method, "color": GREEN, "marker": "s"})


def looks(methods: Sequence[str]) -> list[dict[str, Any]]:
    """Label, colour and marker of results drawn together, by their methods: that of the method, and another where an
    earlier result has its colour; of results by one method the second and later are numbered.
    """
    found: list[dict[str, Any]] = []
    kept = [look(method)["color"] for method in methods]
    for number, method in enumerate(methods):
        style, used = dict(look(method)), [one["color"] for one in found]
        if style["color"] in used:
            others = [(color, marker) for color, marker in _OTHERS if color not in (*kept, *used)]
            style["color"], style["marker"] = (others or _OTHERS)[0]
        if earlier := list(methods[:number]).count(method):
            style["label"] = f"{style['label']}, {earlier + 1}"
        found.append(style)
    return found


def in_short(method: str, style: dict[str, Any]) -> str:
    """The name of a method, numbered as its label is."""
    return f"{method}{style['label'].removeprefix(look(method)['label'])}"


@contextmanager
def styled() -> Iterator[None]:
    """Draw within this context. Raises ExtraMissing without matplotlib."""
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise ExtraMissing("plot", "matplotlib") from error
    mpl.use("Agg")  # pictures are files; no window is needed
    with mpl.rc_context(fname=_SHEET), warnings.catch_warnings():
        # An svg keeps letters as text, for fonts of the reader; elsewhere a box stands for one that the font lacks.
        warnings.filterwarnings("ignore", message=r"Glyph \d+ .* missing from")
        yield


def tick_step(extent: float, count: float) -> float:
    """1, 2 or 5 times a power of ten, by which at most about this many ticks lie on an extent above 0."""
    least = extent / count
    power = 10.0 ** math.floor(math.log10(least))
    return power * next(times for times in (1.0, 2.0, 5.0, 10.0) if times * power >= 0.999 * least)


def log_ticks(axis: Any, at: Sequence[float] = ()) -> None:
    """Plain numbers at the ticks of `axes.xaxis` or `axes.yaxis` with a log scale; without `at` 1, 2 and 5."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator

    axis.set_major_locator(FixedLocator(list(at)) if at else LogLocator(subs=(1.0, 2.0, 5.0), numticks=30))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.{2 if at else 3}g}"))


def widened(ends: tuple[float, float], least: float) -> tuple[float, float]:
    """Limits of a log axis about the same middle, of which the upper one is at least this many times the lower one."""
    more = max(least * ends[0] / ends[1], 1.0) ** 0.5
    return ends[0] / more, ends[1] * more


def pale(colour: str) -> tuple[float, ...]:
    """A quarter of a colour on white, under text."""
    from matplotlib.colors import to_rgb

    return tuple(0.75 + 0.25 * part for part in to_rgb(colour))


def wrapped(text: str, characters: int) -> list[str]:
    """Lines of at most this many characters; names and words with a hyphen stay whole."""
    return textwrap.wrap(text, characters, break_on_hyphens=False)


def caption_lines(text: str, inches: float) -> list[str]:
    """Lines of a caption of this width."""
    return wrapped(text, int(14 * inches))  # letters of 8 points


def caption(figure: Figure, text: str) -> None:
    """A caption under the figure, over its width."""
    lines = caption_lines(text, figure.get_figwidth())
    figure.supxlabel("\n".join(lines), fontsize=8, color=INK, x=0.01, ha="left")


def pressure_unit(unit: str, most: float) -> tuple[float, str]:
    """What to divide pressures up to `most` by, and their unit then: kPa instead of thousands of Pa."""
    return (1e3, "kPa") if unit == "Pa" and most >= 1e3 else (1.0, "counts" if unit == "count" else unit)


def three_digits(value: float) -> str:
    """A number with three digits, those before the point all, and without an exponent: counts have four."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def save(figure: Figure, path: Path) -> Path:
    """Write a figure, whole or not at all, and forget it."""
    import matplotlib.pyplot as plt

    form = path.suffix.removeprefix(".")
    with whole_file(path) as part:
        figure.savefig(part, format=form, metadata={"Date": None} if form == "svg" else None)
    plt.close(figure)
    return path
