from __future__ import annotations

import numpy as np
import pytest

from taxelflow.publish.view.placement import placed
from taxelflow.publish.view.plates import Plates
from taxelflow.sensors.catalogue import load_sensor


@pytest.mark.parametrize("name", ["icub-forearm", "barretthand-162", "inspire-rh56dftp@3.0mm", "hexagon-61"])
def test_a_plate_lies_under_all_taxels_of_its_pad(name: str) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    from viser.transforms import SO3

    from taxelflow.publish.view.server import PageServer

    layout = load_sensor(name).layout
    placement = placed(layout)
    with PageServer(port=0) as server:
        plates = Plates(server.viser, layout, placement)
        plates.move(placement)
        assert sorted(pad for pads, _ in plates._batches for pad in pads) == [*range(layout.pad_count)]
        for pads, batch in plates._batches:
            for number, pad in enumerate(pads):
                own = layout.of_pad(pad)
                R = SO3(batch.batched_wxyzs[number].astype(float)).as_matrix()
                inside = (placement.place[own] - batch.batched_positions[number]) @ R
                assert inside[:, 2].min() > 0
                assert inside[:, 2].max() < 0.1 * layout.pitch_m[pad].max()
                outline = batch.vertices[: len(batch.vertices) // 2, :2]
                edge = np.roll(outline, -1, axis=0) - outline
                off = inside[:, np.newaxis, :2] - outline
                left = (edge[:, 0] * off[..., 1] - edge[:, 1] * off[..., 0]) / np.linalg.norm(edge, axis=1)
                assert left.min() > 0.5 * layout.pitch_m[pad].min()  # taxels and half a pitch around them
