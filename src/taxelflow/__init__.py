"""Touch-based motion sensing for robot hands: pressure scans in, object motion and slip out."""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording, Truth
    from taxelflow.acquire.columns import Columns
    from taxelflow.acquire.trajectory import Trajectory, read_trajectory
    from taxelflow.condition.parameters import Conditioner
    from taxelflow.contacts.features import ContactFeatures
    from taxelflow.errors import TaxelflowError
    from taxelflow.estimation.smoothing.parameters import Smoothing
    from taxelflow.evaluation.calibrate import calibrate
    from taxelflow.fusion.parameters import RigidField
    from taxelflow.messages import Estimates, Event, Motions, RawScans, Scans, Slips
    from taxelflow.pipeline.api import convert, estimate, estimator, read, recording
    from taxelflow.pipeline.live.api import Live
    from taxelflow.pipeline.result import PadResult, Result
    from taxelflow.pipeline.stages import Pipeline
    from taxelflow.sensors.calibration import Calibration, load_calibration, save_calibration
    from taxelflow.sensors.catalogue import load_sensor
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.pads import Pad
    from taxelflow.sensors.sensor import Sensor
    from taxelflow.simulation.parameters import Contact, Load, Motion, Second, Sensing
    from taxelflow.simulation.scenario import SCENARIOS, Scenario
    from taxelflow.simulation.simulate import simulate
    from taxelflow.slip.parameters import SlipMonitor

__version__ = "0.1.0"

_HOME = {
    "Calibration": "sensors.calibration",
    "Columns": "acquire.columns",
    "Conditioner": "condition.parameters",
    "Contact": "simulation.parameters",
    "ContactFeatures": "contacts.features",
    "Estimates": "messages",
    "Event": "messages",
    "Layout": "sensors.layout",
    "Live": "pipeline.live.api",
    "Load": "simulation.parameters",
    "Motion": "simulation.parameters",
    "Motions": "messages",
    "Pad": "sensors.pads",
    "PadResult": "pipeline.result",
    "Pipeline": "pipeline.stages",
    "RawScans": "messages",
    "Recording": "acquire.base",
    "Result": "pipeline.result",
    "RigidField": "fusion.parameters",
    "SCENARIOS": "simulation.scenario",
    "Scans": "messages",
    "Scenario": "simulation.scenario",
    "Second": "simulation.parameters",
    "Sensing": "simulation.parameters",
    "Sensor": "sensors.sensor",
    "SlipMonitor": "slip.parameters",
    "Slips": "messages",
    "Smoothing": "estimation.smoothing.parameters",
    "TaxelflowError": "errors",
    "Trajectory": "acquire.trajectory",
    "Truth": "acquire.base",
    "calibrate": "evaluation.calibrate",
    "convert": "pipeline.api",
    "estimate": "pipeline.api",
    "estimator": "pipeline.api",
    "load_calibration": "sensors.calibration",
    "load_sensor": "sensors.catalogue",
    "read": "pipeline.api",
    "read_trajectory": "acquire.trajectory",
    "recording": "pipeline.api",
    "save_calibration": "sensors.calibration",
    "simulate": "simulation.simulate",
}

__all__ = [
    "SCENARIOS",
    "Calibration",
    "Columns",
    "Conditioner",
    "Contact",
    "ContactFeatures",
    "Estimates",
    "Event",
    "Layout",
    "Live",
    "Load",
    "Motion",
    "Motions",
    "Pad",
    "PadResult",
    "Pipeline",
    "RawScans",
    "Recording",
    "Result",
    "RigidField",
    "Scans",
    "Scenario",
    "Second",
    "Sensing",
    "Sensor",
    "SlipMonitor",
    "Slips",
    "Smoothing",
    "TaxelflowError",
    "Trajectory",
    "Truth",
    "calibrate",
    "convert",
    "estimate",
    "estimator",
    "load_calibration",
    "load_sensor",
    "read",
    "read_trajectory",
    "recording",
    "save_calibration",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that `taxelflow --help` needs neither NumPy nor numba."""
    if name in _HOME:
        return getattr(import_module(f"taxelflow.{_HOME[name]}"), name)
    raise AttributeError(f"module 'taxelflow' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Public names, for the completion of editors and notebooks."""
    return sorted({*globals(), *__all__})


if "gymnasium" in sys.modules:  # it has no plugins: an environment is known once its package was imported
    import_module("taxelflow.simulation.mujoco.environment")
