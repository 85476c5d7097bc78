"""Help texts and messages are plain technical English: an imperative or a noun of the field first, and the unit."""

from __future__ import annotations

import ast
import re
import typing
from pathlib import Path
from typing import Any

import pytest

from helped import Help, commands, options
from taxelflow.runtime import registry
from taxelflow.simulation.scenario import Scenario

SOURCE = Path(__file__).resolve().parents[1] / "src" / "taxelflow"

_IMPERATIVES = """
add calibrate check compare convert detect draw emulate estimate film fit list measure play predict print read record
register repeat report run serve simulate split subtract sweep use write
"""
IMPERATIVES = set(_IMPERATIVES.split())
"""Verbs that a help text may begin with."""
_NOUNS = """
address age amplitude angle anisotropy arrangement baud bitrate block buffer calibration centre change clock
cohesion column columns contact count creep cut-off cycle deformation delay device direction directories
directory distance drift duration effect estimator estimators exponent factor false false-alarm fault faults
feature feet file folder force format frame frames frequency gain gains group handling height host interval joint kind
kinds latency layout layouts length level limit load margin method middle mode moment motion multiple name names npz
number numbers offset order orientation pad pads parameters part pattern period phase pitch port position positions
prefix pressure prior probability processing radius rate ratio reading recording recordings resolution result results
robot rotation scan scans scenario scenarios seed sensor sensors separator shape shapes share side slip speed
standard strength stroke strokes taxel taxels temperature texture threshold time timeout title toml topic topics
torque trajectory turn type unit url velocity wavelength weight width window
"""
NOUNS = set(_NOUNS.split())
"""Nouns of the field that a help text may begin with."""
_ADJECTIVES = """
accepted first full highest largest longest lowest maximum mean minimum relative second serial shortest smallest
socket stiff total
"""
ADJECTIVES = set(_ADJECTIVES.split())
"""Adjectives that may stand before such a noun."""
UNITS = {
    "m": r"\bm\b",
    "s": r"\bs\b",
    "m_s": r"\bm/s\b",
    "rad_s": r"\brad/s\b",
    "rad": r"\brad\b",
    "hz": r"\bHz\b",
    "pa": r"\bPa\b",
    "pa_s": r"\bPa/s",
    "scans": r"\bscans\b",
    "1_m": r"per metre",
    "m_s2": r"\bm/s\b",
    "mm": r"\bmm\b",
    "ms": r"\bms\b",
    "n": r"\bN\b",
    "deg": r"\bdeg\b",
    "per_hour": r"(per hour|1/h)",
}
"""What a text must say of an option whose name ends so, the longest ending first."""
NUMBER = re.compile(
    r"\b(m|s|h|Hz|Pa|rad|bits|m/s|mm|ms|N|numbers?|ratio|share|relative|factor|exponent|gain|seeds?|mean 1|multiples?"
    r"|standard deviations|divided by|port|baud)\b",
    re.IGNORECASE,
)
"""One of these stands in the text of every number."""
BANNED = (
    "so many",
    "so much earlier",
    "vouched",
    "way over",
    "path and rights",
    "anew",
    "seldom",
    "all the same",
    "are well",
    "not well",
    "checks up",
    "slip =",
    "position =",
    "knows none",
    "is told",
    "tells",
    "nothing remembered",
)
"""Words that people who read the house's first texts did not understand."""
PLACES = sorted(commands())


def fault(text: str | None) -> str:
    """What is wrong with the begin of a help text; empty if nothing is."""
    if not text:
        return "has no text"
    words = [word.strip(".,:;()`\"'").lower() for word in text.split()]
    while words and words[0] in {*ADJECTIVES, "and"}:
        words = words[1:]
    first = words[0] if words else ""
    known = first in IMPERATIVES | NOUNS or first.partition("-")[0] in NOUNS
    if not known:
        return f"begins with {first!r}, neither an imperative nor a noun of the field"
    if banned := [word for word in BANNED if word in text.lower()]:
        return f"says {banned[0]!r}"
    return ""


def missing_unit(option: Help) -> str:
    """What unit the text of a number lacks; empty if it lacks none."""
    if not _is_number(option.kind):
        return ""
    text = option.text or ""
    for ending in sorted(UNITS, key=len, reverse=True):
        if option.name.endswith(f"_{ending}"):
            return "" if re.search(UNITS[ending], text) else f"does not name its unit {ending}"
    return "" if NUMBER.search(text) else "does not say what is counted or in which unit"


def _is_number(kind: Any) -> bool:
    parts = typing.get_args(kind)
    return kind in (int, float) or (typing.get_origin(kind) is not typing.Literal and any(map(_is_number, parts)))


def faults(found: list[Help]) -> list[str]:
    """What is wrong, a line per option."""
    wrong = [(one.where, fault(one.text) or missing_unit(one)) for one in found]
    return [f"{where}: {what}" for where, what in wrong if what]


def texts(place: str) -> list[Help]:
    return list(options(place, commands()[place]))


@pytest.mark.parametrize("place", PLACES)
def test_a_command_begins_with_an_imperative(place: str) -> None:
    doc = commands()[place].__doc__ or ""
    assert doc.split()[0].lower() in IMPERATIVES, f"{place}: {doc[:60]}"
    assert not [word for word in BANNED if word in doc.lower()]


@pytest.mark.parametrize("place", PLACES)
def test_an_option_begins_with_an_imperative_or_a_noun_and_names_its_unit(place: str) -> None:
    assert faults(texts(place)) == []


def test_the_fields_of_scenarios_do_too() -> None:
    assert faults(list(options("simulate", Scenario))) == []


def test_every_command_method_and_score_is_among_them() -> None:
    from taxelflow.cli import main

    printed: list[str] = []
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit):
        patch.setenv("COLUMNS", "200")
        patch.setattr("sys.stdout.write", printed.append)
        main(["--help"])
    listed = re.search(r"\{([\w,-]+)\}", "".join(printed))
    assert listed
    assert set(listed[1].split(",")) <= set(PLACES)
    for stage, prefix in (("estimator", "estimate --method"), ("score", "score")):
        assert {f"{prefix} {name}" for name in registry.names(stage)} <= set(PLACES)
    assert sum(len(texts(place)) for place in PLACES) > 80


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "no text"),
        ("", "no text"),
        ("Slip = a motion that noise, load and creep explain more seldom than so many times an hour.", "so many"),
        ("Slip = a fast change of the load.", "slip ="),
        ("The robot's clock and the sensor's agree within so many seconds", "'the'"),
        ("... or in which the anisotropy is less", "neither"),
        ("How much the velocity may change", "'how'"),
        ("batch: longer contacts are solved", "'batch'"),
        ("Number of poses that are not vouched for", "vouched"),
    ],
)
def test_phrases_of_the_first_texts_are_refused(text: str | None, says: str) -> None:
    assert says in fault(text)


@pytest.mark.parametrize(
    ("name", "text"),
    [("search_s", "Largest clock offset to search."), ("share", "Weight of the border."), ("travel_m", "Length, mm.")],
)
def test_a_number_without_its_unit_is_refused(name: str, text: str) -> None:
    assert missing_unit(Help("here", name, float, text))
    assert missing_unit(Help("here", name, typing.Optional[float], text))  # noqa: UP045


@pytest.mark.long
def test_no_message_uses_words_that_people_did_not_understand() -> None:
    found = []
    for path in sorted(SOURCE.rglob("*.py")):
        tree = ast.parse(path.read_text())
        docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
                found += [f"{path.name}:{node.lineno}: {word}" for word in BANNED if word in node.value.lower()]
    assert found == []
