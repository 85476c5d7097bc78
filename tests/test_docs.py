"""The documentation names files, commands, methods and scenarios that exist, and its pages are short.

The commands of extending.md are run by test_extending.py.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

import taxelflow
from taxelflow.cli import main
from taxelflow.runtime import registry
from taxelflow.simulation.scenario import SCENARIOS

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.glob("*.md"), *DOCS.glob("tutorials/*.md")])
README = ROOT / "README.md"
MOST_WORDS = 1200
"""On a page of the documentation, by white space. The glossary is read a line at a time, a decision record once."""

CODE = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"`([^`]+)`")
SHELL = ("sh", "console", "text", "")
FILE = re.compile(r"(?<![\w/.*<-])((?:[\w.-]+/)*[\w-]+\.py)\b")
FOLDER = re.compile(r"^(?:[\w.-]+/)+$")
LINK = re.compile(r"\]\(([^)\s]+)\)")


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def prose(page: Path) -> str:
    """A page without its blocks of code."""
    return CODE.sub("", page.read_text())


def code(page: Path) -> list[str]:
    """Lines for a shell, and what stands between backticks, on one line each."""
    blocks = [line for kind, block in CODE.findall(page.read_text()) if kind in SHELL for line in block.splitlines()]
    return [*blocks, *(" ".join(span.split()) for span in SPAN.findall(prose(page)))]


def heading_anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as web views of Markdown make them."""
    headings = re.findall(r"^#+ (.*)$", CODE.sub("", page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.fixture(scope="module")
def files() -> list[str]:
    """Paths of all files and folders of the checkout that a page may name, each with a slash before it."""
    found = [path for top in ("src", "tests", "examples") for path in (ROOT / top).rglob("*")]
    return [f"/{path.relative_to(ROOT)}{'/' * path.is_dir()}" for path in found]


@pytest.fixture(scope="module")
def commands() -> set[str]:
    """Names of the commands, as the usage line of `taxelflow --help` lists them."""
    printed: list[str] = []
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit):
        patch.setenv("COLUMNS", "200")
        patch.setattr("sys.stdout.write", printed.append)
        main(["--help"])
    usage = re.search(r"\{([\w,-]+)\}", "".join(printed))
    assert usage
    return set(usage[1].split(","))


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "glossary.md"], ids=named)
def test_a_page_is_short(page: Path) -> None:
    assert len(page.read_text().split()) <= MOST_WORDS


@pytest.mark.parametrize("page", [*PAGES, README], ids=named)
def test_files_and_folders_on_a_page_exist(page: Path, files: list[str]) -> None:
    text = prose(page)
    text = LINK.sub("]", text)  # links have a test of their own
    paths = [*FILE.findall(text), *(span for span in SPAN.findall(text) if FOLDER.fullmatch(span))]
    assert [path for path in paths if not any(file.endswith(f"/{path}") for file in files)] == []


@pytest.mark.parametrize("page", [*PAGES, README, *sorted(DOCS.glob("decisions/*.md"))], ids=named)
def test_links_on_a_page_lead_somewhere(page: Path) -> None:
    for link in LINK.findall(prose(page)):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.is_file() or (page == README and target.is_dir()), link  # the site has no folders
        assert not anchor or anchor in heading_anchors(target), link


@pytest.mark.parametrize("page", [*PAGES, README], ids=named)
def test_estimates_to_type_name_their_results(page: Path) -> None:
    lines = [line for kind, block in CODE.findall(page.read_text()) if kind in SHELL for line in block.splitlines()]
    bare = [line for line in lines if "taxelflow estimate " in line and not re.search(r"--(out|help)\b", line)]
    assert bare == []


@pytest.mark.parametrize("page", [*(page for page in PAGES if page.name != "extending.md"), README], ids=named)
def test_commands_on_a_page_are_known(page: Path, commands: set[str]) -> None:
    for line in code(page):
        for command, what in re.findall(r"(?:^|[\s(;&])taxelflow ([a-z][\w-]*)(?: ([a-z][\w-]*)(?=\s|$))?", line):
            assert command in commands, line
            if command == "score" and what:
                assert what in registry.names("score"), line
            if command == "simulate" and what:
                assert what in SCENARIOS, line
        for what in re.findall(r"^score ([a-z]\w*)", line):
            assert what in registry.names("score"), line
        for scenario in re.findall(r"score limits ([a-z][\w-]*)", line):
            assert scenario in SCENARIOS, line
        for method in re.findall(r"--method ([a-z]\w*)", line):
            assert method in registry.names("estimator"), line


@pytest.mark.parametrize("path", sorted(DOCS.glob("results/*.csv")), ids=named)
def test_results_are_tables_that_a_page_names(path: Path) -> None:
    with path.open(newline="") as file:
        heading, *rows = csv.reader(file)
    assert rows
    assert all(len(row) == len(heading) for row in rows)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", name) for name in heading)
    assert any(f"(results/{path.name})" in page.read_text() for page in PAGES)


def test_the_container_runs_as_the_owner_of_the_folder_that_it_writes_to() -> None:
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    [started] = [line for line in lines if line.startswith("#") and "docker run" in line]
    assert '--user "$(id -u):$(id -g)"' in started  # a folder that Docker makes belongs to root
    assert "ENV HOME=/tmp NUMBA_CACHE_DIR=/tmp/numba" in lines  # a user without a home compiles and draws, too


def test_the_reference_has_every_public_name() -> None:
    named_there = set(re.findall(r"taxelflow\.(\w+)", (DOCS / "reference.md").read_text()))
    assert named_there >= set(taxelflow.__all__)


def test_every_page_is_in_the_table_of_contents() -> None:
    listed = set(re.findall(r"^[\w/-]+$", (DOCS / "index.md").read_text(), re.MULTILINE))
    names = {str(page.relative_to(DOCS).with_suffix("")) for page in PAGES}
    assert names - listed == {"index"}
