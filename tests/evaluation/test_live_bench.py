"""What the table of a live loop shows beside its latencies."""

from __future__ import annotations

import pytest

from taxelflow.evaluation.live_bench import LiveBench, LiveReport, PacedRow, StepRow


def test_a_latency_has_the_wait_for_a_core_beside_it(capsys: pytest.CaptureFixture[str]) -> None:
    step = StepRow("convolution", 1000.0, 2000, 0.1, 0.5, 1.3, 1.6, 0, 0)
    paced = PacedRow("convolution", 1000.0, 5.0, 5000, 0, 0.67, 11.9, 28.6, 3.5, 0.321, 270.3, 0.014)
    LiveReport([step], [], [paced], [], []).show()
    assert "load average 3.5, 32.1 % of the time waited for a core" in capsys.readouterr().out


@pytest.mark.long
def test_a_paced_run_is_measured() -> None:
    report = LiveBench(("convolution",), seconds=0.2, paced_s=0.2, late_seeds=0).run()
    [row] = report.paced
    assert row.scans_in == 200
    assert not row.core_wait >= 1.0
