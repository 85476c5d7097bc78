"""Sensors by name: those that come with taxelflow or with other packages, plain grids, and files.

A sensor whose maker does not publish the pitch is named with it, as in `inspire-rh56dftp@3.0mm`. A plain grid is
`grid:16x16@4mm` (rows x cols at a pitch, in counts), `grid:4x7@10x10.6mm` (pitch along x, y) or `grid:16x16@4mm,kPa`.
"""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Any

from taxelflow.errors import GridNameInvalid, NameUnknown, PitchNeeded, SensorFileInvalid
from taxelflow.runtime import registry
from taxelflow.sensors.sensor import Sensor, checked, read_sensor, sensor_of, sensor_table, unchecked

_PITCH = r"(?P<x>\d+(\.\d+)?)(x(?P<y>\d+(\.\d+)?))?mm"
_GRID = re.compile(rf"grid:(?P<rows>\d+)x(?P<cols>\d+)@{_PITCH}(,(?P<unit>\w+(/\w+)?))?")
_AT = re.compile(_PITCH)
_WAYS = ("a plain grid such as grid:16x16@4mm", "or the path of a TOML file")


def builtin_sensors() -> list[str]:
    """Names of the sensors that come with taxelflow."""
    return sorted(Path(file.name).stem for file in _folder().iterdir() if file.name.endswith(".toml"))


def known_sensors() -> list[str]:
    """Names and patterns that `load_sensor` accepts, for error messages."""
    return [*builtin_sensors(), *registry.names("sensor"), *_WAYS]


def catalogue() -> list[tuple[str, Sensor]]:
    """All built-in sensors, unchecked, by name, and those of other packages; a pitch to be given is 1 mm.

    Raises PluginBroken.
    """
    listed = []
    for name in builtin_sensors():
        table = _declared(name)
        needed = _needs_pitch(table)
        sensor = unchecked(_pitched(name, table, "1mm" if needed else ""), f"{name}.toml", _folder())
        listed.append((f"{name}@PITCHmm" if needed else name, sensor))
    return listed + [(name, _announced(name)) for name in registry.names("sensor")]


def sensor_from(given: str | Path | Sensor) -> Sensor:
    """The sensor that a caller in Python gives: by name, by path, or made there.

    Raises what `load_sensor` raises, and SensorFileInvalid for a faulty `Sensor`.
    """
    return checked(given) if isinstance(given, Sensor) else load_sensor(given)


def load_sensor(name: str | Path) -> Sensor:
    """A built-in sensor, one of another package or a plain grid by name, or one from a TOML file by path.

    Raises NameUnknown (with the list of names), PitchNeeded, GridNameInvalid, SensorFileInvalid (with file, table and
    field), PluginBroken.
    """
    name = str(name)
    stem, _, at = name.partition("@")
    if stem in builtin_sensors():
        return _builtin(stem, at)
    if name.startswith("grid:"):
        return _grid(name)
    path = Path(name)
    if path.is_file():
        return read_sensor(path)
    if name in registry.names("sensor"):
        return checked(_announced(name))
    if path.suffix == ".toml" or path.parent != Path():
        seen = "it is no regular file" if path.exists() else "there is no such file"
        raise SensorFileInvalid(name, "path", seen, "give the path of a TOML file, or a name of `taxelflow sensors`")
    raise NameUnknown("sensor", name, known_sensors())


def _folder() -> Any:
    return resources.files("taxelflow") / "sensors" / "data"


def _declared(name: str) -> dict[str, Any]:
    return sensor_table((_folder() / f"{name}.toml").read_bytes(), f"{name}.toml")


def _needs_pitch(table: dict[str, Any]) -> bool:
    return any("rows" in pad and "pitch_m" not in pad for pad in table["pads"])


def _builtin(name: str, at: str) -> Sensor:
    return sensor_of(_pitched(name, _declared(name), at), f"{name}.toml", _folder())


def _pitched(name: str, table: dict[str, Any], at: str) -> dict[str, Any]:
    """The declaration of a built-in sensor, with the pitch that the user has given."""
    needed, given = _needs_pitch(table), _AT.fullmatch(at)
    if needed and not given:
        raise PitchNeeded(name, at)
    if at and not needed:
        raise NameUnknown("sensor", f"{name}@{at}", [name, "whose pitch is known"])
    if given:
        for pad in table["pads"]:
            pad.setdefault("pitch_m", _pitch_m(given))
        table["name"] = f"{name}@{at}"
    return table


def _announced(name: str) -> Sensor:
    """What the function of an entry point gives. Raises PluginBroken."""
    make = registry.find("sensor", name)
    made = make() if callable(make) else make
    if not isinstance(made, Sensor):
        error = TypeError(f"it gives a {type(made).__name__}, not a Sensor")
        raise registry.broken("sensor", name, error)
    return made


def _grid(name: str) -> Sensor:
    given = _GRID.fullmatch(name)
    if given is None:
        raise GridNameInvalid(name)
    unit = given["unit"] or "count"
    pad = {"name": "grid", "rows": int(given["rows"]), "cols": int(given["cols"]), "pitch_m": _pitch_m(given)}
    return sensor_of({"name": name.replace(",", "-"), "unit": unit, "pads": [pad]}, name)


def _pitch_m(given: re.Match[str]) -> list[float]:
    return [1e-3 * float(given["x"]), 1e-3 * float(given["y"] or given["x"])]
