"""The command `taxelflow simulate SCENARIO`: a subcommand per scenario, whose options are the scenario's fields."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro

from taxelflow.errors import ParameterInvalid
from taxelflow.simulation.scenario import DESCRIPTIONS, SCENARIOS, Scenario


@dataclass(frozen=True, kw_only=True)
class Simulated(Scenario):
    """Simulate a recording: one object moved over a pad or the hand; truth and all parameters go into the file."""

    out: Path
    """NPZ file to write."""


_Scenarios = tyro.extras.subcommand_type_from_defaults(
    {
        name: Simulated(**{item.name: getattr(scenario, item.name) for item in fields(scenario)}, out=tyro.MISSING)
        for name, scenario in SCENARIOS.items()
    },
    descriptions=DESCRIPTIONS,
    prefix_names=False,
)


@dataclass(frozen=True)
class Simulate:
    """Simulate a recording: an object moved by a robot over a pad or the hand, truth and all parameters in the file."""

    scenario: Annotated[_Scenarios, tyro.conf.arg(name="")]  # type: ignore[valid-type]
    """Scenario to simulate; its options follow its name."""

    def run(self, _rest: list[str]) -> int:
        """Simulate and write."""
        from taxelflow.simulation.simulate import save

        asked: Simulated = self.scenario
        if asked.out.suffix != ".npz":
            raise ParameterInvalid("out", str(asked.out), "end in .npz")
        recording = save(Scenario(**{item.name: getattr(asked, item.name) for item in fields(Scenario)}), asked.out)
        print(f"{recording.scans} scans of {recording.sensor.name} in {asked.out}")
        return 0
