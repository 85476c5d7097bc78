"""Topics of results that are JSON, in MCAP files and for Foxglove: their schemas."""

from __future__ import annotations

import json
from typing import Any

Properties = dict[str, dict[str, Any]]
_NUMBER = {"type": ["number", "null"]}
SCHEMAS: dict[str, tuple[str, Properties]] = {
    "/slips": ("taxelflow.Slips", {"t_s": {"type": "number"}, "pads": {"type": "object"}}),
    "/object": (
        "taxelflow.Object",
        dict.fromkeys(("t_s", "vx_m_s", "vy_m_s", "omega_rad_s", "x_m", "y_m"), _NUMBER),
    ),
    "/object3d": (
        "taxelflow.Object3d",
        dict.fromkeys(("t_s", "vx_m_s", "vy_m_s", "vz_m_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"), _NUMBER),
    ),
    "/events": ("taxelflow.Event", {"t_s": _NUMBER, "pad": {"type": "string"}, "event": {"type": "string"}}),
}
"""Name of the schema and its properties, by topic."""


def json_schema(name: str, properties: Properties) -> bytes:
    """A JSON schema."""
    return json.dumps({"title": name, "type": "object", "properties": properties}).encode()
