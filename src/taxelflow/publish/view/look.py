"""Sizes, gaps and limits of what the view draws, from `look.toml`, which gives their units and reasons."""

from __future__ import annotations

from importlib.resources import files

import msgspec


class _Camera(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    fov_rad: float
    margin: float
    aspect: float
    front: tuple[float, float, float]
    from_above: tuple[float, float, float]
    front_mean_normal: float
    hidden_weight: float
    heights_deg: tuple[float, ...]
    turns: int
    hand_poses: int
    same_turn_deg: float
    same_place: float
    same_fit: float


class Light(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A light at infinity. along: where it is, along the axes of the picture."""

    intensity: float
    along: tuple[float, float, float]


class _Lights(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    ambient: float
    key: Light
    fill: Light


class _Taxels(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    floor: float
    raised: float
    arrows_above: float
    pitch_share: float


class _Plates(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    plane: float
    rim: float
    thick: float
    below: float
    corners: int


class _Links(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    sections: int
    joint: float
    behind: float
    rim: float
    opacity: float


class _Body(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    spare: float
    least: float


class _Arrows(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pads_across: float
    ring: float
    rings: int
    longest: float
    wide: float
    slim: float
    head: float
    shaft: float


class _Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    steps: int
    turn_s: float
    most_rad: float
    thick: float
    sigmas: float
    widest: float
    ellipses: int
    hides: float
    blind_ring: int


class _Names(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    few: int
    large: float
    small: float
    em: int
    edge: int


class _Legend(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    size: tuple[int, int]
    bar: tuple[int, int, int, int]
    rows: tuple[int, int]
    radius: int
    wide: float
    below: float
    height_share: float


class _Room(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    gap: float
    between: float
    near: float
    name: tuple[float, float]
    wide: float


class _Panel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    wide: int
    map: int
    table_rows: int
    saved: tuple[int, int]
    speeds: tuple[float, ...]


class _Plots(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    shown_s: float
    points: int
    height: int
    padding: tuple[int, int, int, int]
    ratios: tuple[float, float]


class _Film(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    wide: int
    high: int
    border: int
    farther: float
    frames: int


class _Strip(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    wide: int
    names: int
    lane: int
    foot: int
    lanes: int
    bars: int
    listed: int
    buttons: int


class _Look(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The tables of the file, one for each thing that is drawn."""

    camera: _Camera
    lights: _Lights
    taxels: _Taxels
    plates: _Plates
    links: _Links
    body: _Body
    arrows: _Arrows
    motion: _Motion
    names: _Names
    legend: _Legend
    room: _Room
    panel: _Panel
    plots: _Plots
    film: _Film
    strip: _Strip


_LOOK = msgspec.toml.decode(files(__package__).joinpath("look.toml").read_bytes(), type=_Look)
CAMERA = _LOOK.camera
LIGHTS = _LOOK.lights
TAXELS = _LOOK.taxels
PLATES = _LOOK.plates
LINKS = _LOOK.links
BODY = _LOOK.body
ARROWS = _LOOK.arrows
MOTION = _LOOK.motion
NAMES = _LOOK.names
LEGEND = _LOOK.legend
ROOM = _LOOK.room
PANEL = _LOOK.panel
PLOTS = _LOOK.plots
FILM = _LOOK.film
STRIP = _LOOK.strip
