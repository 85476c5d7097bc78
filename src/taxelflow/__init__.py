"""Touch-based motion sensing for robot hands: pressure scans in, object motion and slip out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording, Truth
    from taxelflow.acquire.columns import Columns
    from taxelflow.api import Result, convert, estimate, estimator, read
    from taxelflow.condition.parameters import Conditioner
    from taxelflow.errors import TaxelflowError
    from taxelflow.messages import Estimates, Event, Motions, RawScans, Scans, Slips
    from taxelflow.pipeline import Pipeline
    from taxelflow.sensors.catalogue import load_sensor
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.pads import Pad
    from taxelflow.sensors.sensor import Sensor
    from taxelflow.slip.parameters import SlipMonitor

__version__ = "0.1.0"

_HOME = {
    "Columns": "acquire.columns",
    "Conditioner": "condition.parameters",
    "Estimates": "messages",
    "Event": "messages",
    "Layout": "sensors.layout",
    "Motions": "messages",
    "Pad": "sensors.pads",
    "Pipeline": "pipeline",
    "RawScans": "messages",
    "Recording": "acquire.base",
    "Result": "api",
    "Scans": "messages",
    "Sensor": "sensors.sensor",
    "SlipMonitor": "slip.parameters",
    "Slips": "messages",
    "TaxelflowError": "errors",
    "Truth": "acquire.base",
    "convert": "api",
    "estimate": "api",
    "estimator": "api",
    "load_sensor": "sensors.catalogue",
    "read": "api",
}

__all__ = [
    "Columns",
    "Conditioner",
    "Estimates",
    "Event",
    "Layout",
    "Motions",
    "Pad",
    "Pipeline",
    "RawScans",
    "Recording",
    "Result",
    "Scans",
    "Sensor",
    "SlipMonitor",
    "Slips",
    "TaxelflowError",
    "Truth",
    "convert",
    "estimate",
    "estimator",
    "load_sensor",
    "read",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that `taxelflow --help` needs neither NumPy nor numba."""
    if name in _HOME:
        return getattr(import_module(f"taxelflow.{_HOME[name]}"), name)
    raise AttributeError(f"module 'taxelflow' has no attribute {name!r}")
