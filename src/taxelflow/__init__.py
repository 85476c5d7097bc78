"""Touch-based motion sensing for robot hands: pressure scans in, object motion and slip out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording, Truth
    from taxelflow.acquire.columns import Columns
    from taxelflow.api import Result, convert, estimate, estimator, read
    from taxelflow.catalogue import load_sensor
    from taxelflow.condition.conditioner import Conditioner
    from taxelflow.errors import TaxelflowError
    from taxelflow.layout import Layout
    from taxelflow.messages import Event, Motions, RawScans, Scans, Slips
    from taxelflow.monitor.slip import SlipMonitor
    from taxelflow.pads import Pad
    from taxelflow.sensor import Sensor

__version__ = "0.1.0"

_HOME = {
    "Columns": "acquire.columns",
    "Conditioner": "condition.conditioner",
    "Event": "messages",
    "Layout": "layout",
    "Motions": "messages",
    "Pad": "pads",
    "RawScans": "messages",
    "Recording": "acquire.base",
    "Result": "api",
    "Scans": "messages",
    "Sensor": "sensor",
    "SlipMonitor": "monitor.slip",
    "Slips": "messages",
    "TaxelflowError": "errors",
    "Truth": "acquire.base",
    "convert": "api",
    "estimate": "api",
    "estimator": "api",
    "load_sensor": "catalogue",
    "read": "api",
}

__all__ = [
    "Columns",
    "Conditioner",
    "Event",
    "Layout",
    "Motions",
    "Pad",
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
