from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from taxelflow.pipeline.batch.manifest import Manifest, Row

DONE, FAILED = Row("/b.npz", "done", 1.25, ""), Row("/a, b.npz", "failed", None, 'no "scan", none')
HEAD = "recording,status,seconds,message\n"


def test_rows_are_appended_at_once_and_sorted_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "manifest.csv"
    with Manifest(path) as manifest:
        manifest.add(DONE)
        assert path.read_text() == HEAD + "/b.npz,done,1.250,\n"
        manifest.add(FAILED)
    assert path.read_text() == HEAD + '"/a, b.npz",failed,,"no ""scan"", none"\n/b.npz,done,1.250,\n'
    assert Manifest(path).rows == {row.recording: row for row in (DONE, FAILED)}


def test_a_later_row_replaces_the_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / "manifest.csv"
    again = FAILED._replace(status="done", seconds=2.0, message="")
    with Manifest(path) as manifest:
        manifest.add(FAILED)
        manifest.add(again)
    assert Manifest(path).rows == {again.recording: again}
    assert manifest.of([Path("/a, b.npz"), Path("/c")], "done") == [again]
    assert manifest.of([Path("/a, b.npz")], "failed") == []


@given(kept=st.integers(0, 200))
def test_of_a_torn_file_the_whole_rows_are_read(tmp_path_factory: object, kept: int) -> None:
    lines = [HEAD, DONE.line(), FAILED.line()]
    whole = "".join(lines)
    path = Path(str(tmp_path_factory.mktemp("torn"))) / "manifest.csv"  # type: ignore[attr-defined]
    path.write_text(whole[:kept])
    ends = [sum(map(len, lines[: count + 1])) for count in range(3)]
    assert list(Manifest(path).rows.values()) == [
        row for row, end in zip((DONE, FAILED), ends[1:], strict=True) if end <= kept
    ]


def test_a_row_is_one_line_whatever_the_message(tmp_path: Path) -> None:
    path = tmp_path / "manifest.csv"
    with Manifest(path) as manifest:
        manifest.add(Row("/a.npz", "failed", 0.0, "two\nlines, \x1b[31mred"))
    assert path.read_text() == HEAD + '/a.npz,failed,0.000,"two\\nlines, \\x1b[31mred"\n'
