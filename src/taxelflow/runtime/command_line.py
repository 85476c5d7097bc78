"""Words of the command line as objects, by tyro; words that do not fit as an error of one line, not as a box."""

from __future__ import annotations

import io
import re
from contextlib import redirect_stderr
from itertools import groupby
from typing import Any

import tyro

from taxelflow.errors import WordsInvalid
from taxelflow.runtime.exit_codes import ExitCode

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_RULE = re.compile(r"[─\-╭╰╮╯ │]*")
_HELP = re.compile(r"For full helptext, (?:run:?|see) ")


def parsed(kind: Any, words: list[str], prog: str, help_option: str = "--help", **options: Any) -> Any:
    """What `tyro.cli` makes of these words with these options. prog: the command's name in help texts.

    Raises WordsInvalid; SystemExit after a help text.
    """
    written = io.StringIO()
    try:
        with redirect_stderr(written):
            return tyro.cli(kind, args=words, prog=prog, **options)
    except SystemExit as end:
        if end.code != ExitCode.BAD_INPUT:
            raise
        raise WordsInvalid(_in_one_line(written.getvalue()).replace("--help", help_option)) from None


def _in_one_line(box: str) -> str:
    """The sections of a box between a title and rules, without what options mean, which help texts repeat."""
    lines = [_COLOUR.sub("", line) for line in box.splitlines()[1:]]
    sections = [
        " ".join(text for line in group if not (text := line[2:].rstrip(" │")).startswith(" " * 8)).split()
        for ruled, group in groupby(lines, lambda line: bool(_RULE.fullmatch(line)))
        if not ruled
    ]
    *found, helped = [" ".join(section) for section in sections if section[:1] != ["Argument"]]
    message = "; ".join(text.rstrip(".") for text in found)
    return f"{message[:1].lower()}{message[1:]}; see {_HELP.sub('', helped)}"
