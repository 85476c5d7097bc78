from __future__ import annotations

import pytest

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.batch_workers import BatchWorkers

Capture = pytest.CaptureFixture[str]


@pytest.mark.long
def test_rates_are_those_after_each_workers_first_recording(capsys: Capture) -> None:
    report = BatchWorkers(recordings=8, workers=(1, 2), method="lnorm").run()
    one, two = report.rows
    assert one.ratio == 1.0
    assert two.ratio == pytest.approx(one.wall_s / two.wall_s)
    for row in report.rows:
        assert row.first_task_s > row.task_s > 0.0  # kernels are loaded in the first
        assert row.client_s < row.task_s
        assert row.first_wall_s > 0.0
    report.show()
    assert "client CPU s" in capsys.readouterr().out


def test_each_worker_has_recordings_after_its_first() -> None:
    with pytest.raises(ParameterInvalid, match="recordings"):
        BatchWorkers(recordings=7, workers=(1, 2))
    with pytest.raises(ParameterInvalid, match="workers"):
        BatchWorkers(workers=(0,))
