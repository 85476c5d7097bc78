"""Routines as Python can call them: a routine alone is plain Python, and knows records by index only."""

from __future__ import annotations

from taxelflow.runtime.compiling import kernel as compiled

__all__ = ["compiled"]
