"""Every help text of the command line: read from the docstrings that tyro prints."""

from __future__ import annotations

import ast
import inspect
import textwrap
import typing
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from taxelflow.cli import Command
from taxelflow.evaluation.design import Design as Sweep
from taxelflow.runtime import registry

if TYPE_CHECKING:
    from collections.abc import Iterator


class Help(NamedTuple):
    """One option. where: command and option. kind: its type. text: None without a docstring."""

    where: str
    name: str
    kind: Any
    text: str | None


def commands() -> dict[str, type]:
    """Classes of all commands, of the parameters of all methods and of all scores, by what selects them."""
    found: dict[str, type] = {}
    for command in typing.get_args(Command):
        kind, configured = typing.get_args(command)[0], command.__metadata__[0]
        found[configured.name] = kind
    found |= {f"estimate --method {name}": registry.find("estimator", name) for name in registry.names("estimator")}
    found |= {f"score {name}": registry.find("score", name) for name in registry.names("score")}
    return {**found, "design --help-sweep": Sweep}


def options(where: str, kind: type) -> Iterator[Help]:
    """Options of a dataclass, those of its parts too."""
    texts = _docstrings(kind)
    hints = typing.get_type_hints(kind, include_extras=False)
    for field in fields(kind):
        own = hints[field.name]
        if is_dataclass(own):
            yield from options(f"{where} --{field.name}", typing.cast("type", own))
        else:
            yield Help(f"{where} --{field.name}", field.name, own, texts.get(field.name))


def _docstrings(kind: type) -> dict[str, str]:
    """Docstrings of the fields of a class and its bases."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if not is_dataclass(base):
            continue
        try:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        except OSError:
            continue  # made when the program runs
        assert isinstance(tree, ast.ClassDef)
        for statement, following in zip(tree.body, tree.body[1:], strict=False):
            if (
                isinstance(statement, ast.AnnAssign)
                and isinstance(statement.target, ast.Name)
                and isinstance(following, ast.Expr)
                and isinstance(following.value, ast.Constant)
            ):
                found[statement.target.id] = inspect.cleandoc(str(following.value.value))
    return found
