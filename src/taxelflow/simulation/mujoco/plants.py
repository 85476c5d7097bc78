"""Numbers of the physics engine's world, from `plants.toml`, which gives their units and reasons."""

from __future__ import annotations

from importlib.resources import files

import msgspec


class _Solver(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    timestep_s: float
    coupling_solref: tuple[float, float]


class _Contact(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    normal_solref: tuple[float, float]
    friction_solref: tuple[float, float]
    impedance: float
    torsion_m: float
    rolling_m: float
    sheet_m: float
    sliding_m_s: float
    gap_m: float
    grasped: float


class _Gripper(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    jaw_m: float


class _Barrett(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    spread_rad: float
    up: tuple[float, float, float, float]
    vertex_m: float
    cover_m: float
    noise_pa: float
    half_pad_m: float
    base_m: float
    link_m: float
    outer_link_m: float
    knuckle_kg: float
    palm_gap_m: float
    armature: float
    damping: float
    lever_m: float
    levers_m: tuple[float, float]
    lever_s: float
    touched_n: float
    finger: float


class _Trial(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    open_s: float
    closed_s: float
    lift_s: float
    lifted_s: float
    event_s: float
    end_s: float
    motion_end_s: float
    closing_n: float
    dropped_m: float
    near_m: float
    force_cost: float
    lost: float
    lever_m: float


class _Picture(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    most_geoms: int
    arrow_m: float
    nearer: float


class _Plants(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    solver: _Solver
    contact: _Contact
    gripper: _Gripper
    barrett: _Barrett
    trial: _Trial
    picture: _Picture


_PLANTS = msgspec.toml.decode(files(__package__).joinpath("plants.toml").read_bytes(), type=_Plants)
SOLVER = _PLANTS.solver
CONTACT = _PLANTS.contact
GRIPPER = _PLANTS.gripper
BARRETT = _PLANTS.barrett
TRIAL = _PLANTS.trial
PICTURE = _PLANTS.picture
