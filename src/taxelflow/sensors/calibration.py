"""The calibration file that `taxelflow calibrate` writes, and the gains that `estimate` reads from it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np
from msgspec import Meta

from taxelflow.errors import CalibrationInvalid, CalibrationUnfit
from taxelflow.runtime.whole_file import whole_file
from taxelflow.sensors.toml_text import parse_toml, read_limited

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor

Gain = Annotated[float, Meta(gt=0, lt=1e6)]
Deviation = Annotated[float, Meta(ge=0)]


class PadCalibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Calibration of one pad. Without its standard deviation a gain was not observable, and 1 is assumed."""

    name: str
    gain_x: Gain
    """Factor on the index along x, dimensionless; it multiplies the method's own `gain`."""
    gain_y: Gain
    mm_per_index_x: float
    """Factor on the paper's index, mm; 10.5 mm in the paper."""
    mm_per_index_y: float
    T_pad_robot: tuple[float, float, float]
    """Pose x, y, theta (m, m, rad) of the robot's frame in the pad's."""
    std_pad_robot: tuple[Deviation, Deviation, Deviation]
    time_offset_s: float
    """Robot's clock minus the sensor's, s."""
    std_time_offset_s: Deviation
    scans: int
    """Scans with a position that were used."""
    interior_scans: int
    """Those of them far from the border, along the axes whose gain was observable."""
    residual_mm: Deviation
    """Root mean square residual of interior positions (of all positions if there are none), mm."""
    std_x: Deviation | None = None
    std_y: Deviation | None = None
    note: str = ""


class Calibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gains of one method on one sensor."""

    method: str
    sensor: str
    fingerprint: str
    """Hash of the pads' layout: a calibration is refused for another layout."""
    taxelflow: str
    pads: Annotated[tuple[PadCalibration, ...], Meta(min_length=1)]

    def gains(self, sensor: Sensor) -> Floats:
        """(pads, 2) gains along x, y of the sensor's pads, groups and contacts; 1 for pads without a calibration.

        A group has the gain of its pad; one across pads has the mean over its taxels along both axes.
        Raises CalibrationUnfit.
        """
        if (self.sensor, self.fingerprint) != (sensor.name, fingerprint(sensor)):
            same = self.sensor == sensor.name
            raise CalibrationUnfit(
                f"sensor {self.sensor!r}" + (" with another layout" if same else ""), f"sensor {sensor.name!r}"
            )
        layout = sensor.layout
        own = {pad.name: (pad.gain_x, pad.gain_y) for pad in self.pads}
        factors = np.array([own.get(name, (1.0, 1.0)) for name in layout.pads[: layout.pad_count]])
        taxel_starts = layout.starts[: layout.pad_count + 1]
        groups = []
        for group in range(layout.pad_count, len(layout.pads)):
            homes = np.searchsorted(taxel_starts, layout.source[layout.of_pad(group)], side="right") - 1
            alone = len(np.unique(homes)) == 1
            groups.append(factors[homes[0]] if alone else np.full(2, factors[homes].mean()))
        return np.array([*factors, *groups])


def fingerprint(sensor: Sensor) -> str:
    """Hash of the names, grids, pitches, missing taxels and tables of the pads, on which gains depend."""
    parts = [
        (pad.name, pad.rows, pad.cols, pad.pitch_m, sorted(pad.missing), *((pad.taxels,) if pad.is_table else ()))
        for pad in sensor.pads
    ]
    return hashlib.sha256(msgspec.json.encode(parts)).hexdigest()[:16]


def load_calibration(path: str | Path) -> Calibration:
    """A calibration file, checked. Raises CalibrationInvalid; OSError if it cannot be opened."""
    try:
        return msgspec.convert(parse_toml(read_limited(Path(path))), Calibration)
    except msgspec.ValidationError as error:
        seen = str(error).replace("`$.", "`").replace("Object", "table").replace("object", "table")
        raise CalibrationInvalid(path, seen[:1].lower() + seen[1:]) from error
    except ValueError as error:
        raise CalibrationInvalid(path, f"invalid TOML ({error})") from error


def save_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write the file, whole or not at all."""
    with whole_file(Path(path)) as part:
        part.write_text(to_toml(calibration), encoding="utf-8")


def to_toml(calibration: Calibration) -> str:
    """TOML text; unknown values are left out."""
    table = msgspec.to_builtins(calibration)
    pads = table.pop("pads")
    blocks = [table, *pads]
    texts = [
        "".join(f"{key} = {_value(value)}\n" for key, value in block.items() if value is not None) for block in blocks
    ]
    return "\n[[pads]]\n".join(texts)


def _value(value: object) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        return json.dumps(value).replace("\x7f", "\\u007f")  # JSON's escapes are TOML's, but for DEL
    return repr(float(value)) if isinstance(value, float) else str(value)
