"""The options of all commands that estimate: which method, and the parameters of every stage."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.estimation.smoothing.parameters import Smoothing
from taxelflow.fusion.parameters import RigidField
from taxelflow.fusion.spatial.parameters import SpatialField
from taxelflow.runtime import registry
from taxelflow.runtime.command_line import parsed
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from taxelflow.pipeline.stages import Pipeline


@dataclass(frozen=True, kw_only=True)
class Estimating:
    """How motion and slip are estimated."""

    method: str = "convolution"
    """Estimator: lnorm or convolution (the paper's methods I and II), template (learns the object's pressure pattern,
    with rotation), registration (of two scans, with rotation), the baselines sum (no direction) or principal_axis (with
    rotation), or one of another package. Add --help for its own options."""
    mode: Literal["batch", "stream"] = "batch"
    """Processing mode. batch: learn tare and noise from the whole recording first. stream: scan by scan, as from a live
    device."""
    calibration: Path | None = None
    """Calibration file by `taxelflow calibrate`, of the same sensor and method."""
    contacts: str | None = None
    """Largest number of contacts that are separated on every pad, or by pad, such as palm=2,thumb=3. Each becomes a pad
    of its own (palm#1, palm#2). Default: as in the sensor file, usually 1; a rigid object with several feet is one
    contact."""
    condition: Conditioner = field(default_factory=Conditioner)
    monitor: SlipMonitor = field(default_factory=SlipMonitor)
    fusion: RigidField = field(default_factory=RigidField)
    features: ContactFeatures = field(default_factory=ContactFeatures)
    smooth: Smoothing = field(default_factory=Smoothing)
    spatial: SpatialField = field(default_factory=SpatialField)

    def pipeline(self, own: list[str], command: str) -> Pipeline:
        """All stages. own: words of the command line with the method's own options.

        Raises NameUnknown, ParameterInvalid, CalibrationInvalid.
        """
        from taxelflow.pipeline.stages import Pipeline
        from taxelflow.sensors.calibration import load_calibration

        kind = registry.find("estimator", self.method)
        estimator = parsed(kind, own, f"taxelflow {command} --method {self.method}")
        return Pipeline(
            estimator,
            self.mode,
            self.condition,
            self.monitor,
            self.fusion,
            None if self.calibration is None else load_calibration(self.calibration),
            self.features,
            self.smooth,
            self.spatial,
        )
