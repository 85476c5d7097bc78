from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from taxelflow.publish.plots.style import styled

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def style() -> Iterator[None]:
    import matplotlib.pyplot as plt

    with styled():
        yield
    plt.close("all")
