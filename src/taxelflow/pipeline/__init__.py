"""The stages in order (`stages`), and ways to run them: on a recording (`api`), on many (`batch`), live (`live`)."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taxelflow.pipeline.stages import Pipeline, Run

__all__ = ["Pipeline", "Run"]


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that the help of `batch` and `run` needs neither NumPy nor numba."""
    if name in __all__:
        return getattr(import_module("taxelflow.pipeline.stages"), name)
    raise AttributeError(f"module 'taxelflow.pipeline' has no attribute {name!r}")
