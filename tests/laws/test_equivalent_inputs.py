"""What every method owes to equivalent inputs: mirrored pads, pads in another order."""

from __future__ import annotations

import numpy as np
import pytest

from elastic_skin import PLACES, pressed
from taxelflow.numerics.rest_or_slide import compare
from taxelflow.numerics.slid import Skin

SKIN = Skin.of(PLACES.T)
MIRRORED = np.array([np.flatnonzero((place * (-1, 1) == PLACES).all(axis=1))[0] for place in PLACES])
"""(taxels,), the taxel in the place of each one's mirror image."""


@pytest.mark.parametrize("seed", range(5))
def test_the_mirror_image_of_a_slide_is_the_slide_of_the_mirror_image(seed: int) -> None:
    random = np.random.default_rng(seed)
    before, after = (np.round(1e3 * pressed(x=x, y=-0.5 * x) * random.uniform(0.5, 1.5, len(PLACES))) for x in (0, 0.6))
    one, other = (
        compare(SKIN, before[order], after[order], 1.0, np.zeros(3)) for order in (np.arange(len(PLACES)), MIRRORED)
    )
    np.testing.assert_allclose(other, one._replace(x=-one.x), rtol=1e-6)
