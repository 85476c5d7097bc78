"""Files with the pictures of a result: their names and formats, by which those of an earlier result are found."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from taxelflow.errors import ResultMissing
from taxelflow.publish.results import read_summary
from taxelflow.runtime import registry

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

FORMATS = ("svg", "png", "pdf")


def safe(stem: str) -> str:
    """A file's name without what may not be in one, whatever a pad's name is."""
    return re.sub(r"[^\w .,+@=-]", "_", stem)


def pictures_in(directory: Path, pads: Iterable[str], methods: Iterable[str]) -> list[Path]:
    """Files in a directory that have names of pictures by `draw_results`, of these pads and methods."""
    stems = {"views", *(f"{kind}-{pad}" for kind in ("position", "pattern") for pad in pads)}
    stems |= {f"{kind}-{method}" for kind in ("path", "field", "patterns") for method in methods}
    known = "|".join(re.escape(safe(stem)) for stem in stems)
    name = re.compile(rf"({known})(-\d+)?\.({'|'.join(FORMATS)})")
    return [path for path in directory.iterdir() if name.fullmatch(path.name)]


def pictures_of(directory: Path) -> list[Path]:
    """Pictures of the result that a directory holds, beside its tables; none where it holds no result."""
    try:
        pads = read_summary(directory).pads
    except ResultMissing:
        return []
    return pictures_in(directory, pads, registry.names("estimator"))
