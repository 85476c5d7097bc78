"""The paper's field of slip vectors, read as the motion of one rigid object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.runtime.checks import not_negative

if TYPE_CHECKING:
    from taxelflow.fusion.session import FieldSession
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True)
class RigidField:
    """Slip vectors of pads and groups, at their places on the flattened hand, as one translation and rotation."""

    edge_doubt: float = 0.3
    """Share of the largest motion of any pad, and of a pitch, that is added to the standard deviation across a pad's
    border. It is added where the border cuts a contact and the pose is therefore ambiguous. A pose of quality ok, whose
    covariance holds at a border too, has nothing added."""

    def __post_init__(self) -> None:
        not_negative("edge_doubt", self.edge_doubt)

    def start(self, layout: Layout) -> FieldSession:
        """Begin a session."""
        from taxelflow.fusion.session import FieldSession

        return FieldSession(layout, self.edge_doubt)
