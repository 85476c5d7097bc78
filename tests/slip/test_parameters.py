from __future__ import annotations

import math

import pytest

from taxelflow.errors import ParameterInvalid
from taxelflow.slip.parameters import SlipMonitor

NAN = float("nan")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"alarms_per_hour": 0.0}, r"monitor.alarms_per_hour must be a finite number above 0 \(got 0\.0\)"),
        ({"alarms_per_hour": NAN}, r"monitor.alarms_per_hour must .* \(got nan\)"),
        ({"creep_m_s": -1.0}, r"monitor.creep_m_s must be 0 or more \(got -1\.0\)"),
        ({"load_m": math.inf}, r"monitor.load_m must be 0 or more \(got inf\)"),
        ({"settle_s": -0.1}, r"monitor.settle_s must be 0 or more \(got -0\.1\)"),
    ],
    ids=str,
)
def test_parameters_that_cannot_work_are_refused(parameters: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterInvalid, match=message):
        SlipMonitor(**parameters)


def test_a_stream_and_a_recording_have_sessions_of_their_own() -> None:
    from taxelflow.slip.offline import OfflineSlipSession
    from taxelflow.slip.session import SlipSession

    assert isinstance(SlipMonitor().begin(("pad",)), SlipSession)
    assert isinstance(SlipMonitor().look_back(("pad",)), OfflineSlipSession)
