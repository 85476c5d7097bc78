"""Sizes, gaps and limits of the pictures, from `sizes.toml`, which gives their units and reasons."""

from __future__ import annotations

from importlib.resources import files

import msgspec


class _Names(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    points: float
    wide: float
    tall: float
    gap: float


class _Arrows(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    flat: float
    space: float


class _Taxels(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    half_side: float
    corners: int
    alike: float
    numbered: int
    numbered_in_space: int


class _Faces(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    thinnest: float
    darkest: float
    away: float
    readable: float
    distorted: float


class _Paper(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    size_in: tuple[float, float]
    pitch_in: float
    row_points: float
    row_aspect: float


class _Pattern(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    height_in: float
    shown: float
    marks: int
    mark_half: float


class _Position(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    small_above: int
    slopes: int
    events: int
    doubted: float


class _Film(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    dpi: int
    multiple: int
    typical: float
    longest: float
    head: float
    lines: int
    idle: float
    gap_mm: float


class _Sizes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    names: _Names
    arrows: _Arrows
    taxels: _Taxels
    faces: _Faces
    paper: _Paper
    pattern: _Pattern
    position: _Position
    film: _Film


_SIZES = msgspec.toml.decode(files(__package__).joinpath("sizes.toml").read_bytes(), type=_Sizes)
NAMES = _SIZES.names
ARROWS = _SIZES.arrows
TAXELS = _SIZES.taxels
FACES = _SIZES.faces
PAPER = _SIZES.paper
PATTERN = _SIZES.pattern
POSITION = _SIZES.position
FILM = _SIZES.film
