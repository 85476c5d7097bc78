"""The sizes of pictures come from one file, which is read whole."""

import re
from importlib.resources import files

import msgspec
import pytest

from taxelflow.publish.plots import sizes

WORDS = files("taxelflow.publish.plots").joinpath("sizes.toml").read_text()


def test_the_file_is_what_is_drawn() -> None:
    assert msgspec.toml.decode(WORDS, type=sizes._Sizes).arrows == sizes.ARROWS


@pytest.mark.parametrize("line", re.findall(r"(?m)^\w+ = .*$", WORDS)[::9])
def test_a_size_that_lacks_or_has_another_name_is_refused(line: str) -> None:
    for changed in ("", line.replace(" = ", "_other = ", 1)):
        with pytest.raises(msgspec.ValidationError):
            msgspec.toml.decode(WORDS.replace(line, changed), type=sizes._Sizes)
