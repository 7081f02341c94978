"""The journal gives back exactly the rows it was given, and refuses what is not of the same experiment."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.bench.journal import Journal
from viewsep.errors import BadInput

VALUES = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text()
ROWS = st.dictionaries(st.text(), VALUES | st.lists(VALUES), max_size=4)


@pytest.fixture
def result(tmp_path: Path) -> Path:
    return tmp_path / "result.json"


def written(result: Path, count: int) -> Journal:
    journal = Journal(result, "mine", resume=False)
    for number in range(count):
        journal.append(f"row {number}", {"number": number, "share": number / 7})
    return journal


@given(rows=st.lists(ROWS, max_size=4))
def test_rows_come_back_exactly(rows: list[dict[str, object]], tmp_path_factory: pytest.TempPathFactory) -> None:
    result = tmp_path_factory.mktemp("journal") / "result.json"
    journal = Journal(result, "mine", resume=False)
    for number, row in enumerate(rows):
        journal.append(str(number), row)
    again = Journal(result, "mine", resume=True).rows
    assert again == {str(number): row for number, row in enumerate(rows)}
    assert repr(again) == repr({str(number): row for number, row in enumerate(rows)})


def test_infinite_figures_and_those_that_are_none_come_back(result: Path) -> None:
    written(result, 0).append("a", {"low": -math.inf, "error": math.nan})
    row = Journal(result, "mine", resume=True).rows["a"]
    assert row["low"] == -math.inf
    assert math.isnan(row["error"])


def test_half_a_line_at_the_end_is_dropped_and_written_over(result: Path) -> None:
    path = written(result, 3).path
    whole = path.read_bytes()
    for cut in (1, 9, len(whole.splitlines()[-1])):
        path.write_bytes(whole[:-cut])
        journal = Journal(result, "mine", resume=True)
        assert list(journal.rows) == ["row 0", "row 1"]
        journal.append("row 2", {"number": 2, "share": 2 / 7})
        assert path.read_bytes() == whole


def test_rows_that_are_there_are_not_lost_by_forgetting_resume(result: Path) -> None:
    path = written(result, 3).path
    before = path.read_bytes()
    with pytest.raises(
        BadInput, match=rf"{path} holds 3 finished tasks of this experiment.*go on with --resume, or del"
    ):
        Journal(result, "mine", resume=False)
    assert path.read_bytes() == before


@pytest.mark.parametrize("resume", [True, False])
def test_rows_of_another_experiment_are_refused(result: Path, resume: bool) -> None:
    path = written(result, 2).path
    with pytest.raises(BadInput, match=f"{path} holds 2 finished tasks of another experiment"):
        Journal(result, "yours", resume)


@pytest.mark.parametrize("resume", [True, False])
def test_where_no_row_is_kept_the_run_simply_starts(result: Path, resume: bool) -> None:
    for before in (None, b"", b'{"experi', b'{"experiment": "yours"}\n', b'{"experiment": "yours"}\n{"key": "torn'):
        if before is not None:
            result.with_name("result.json.partial").write_bytes(before)
        journal = Journal(result, "mine", resume)
        assert journal.rows == {}
        assert journal.path.read_bytes() == b'{"experiment": "mine"}\n'


@pytest.mark.parametrize("line", [b"{", b"[1, 2]", b'{"key": 3, "row": {}}', b'{"key": "a"}', b"\xff\xfe"])
def test_a_damaged_line_is_named(result: Path, line: bytes) -> None:
    path = written(result, 3).path
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([*lines[:2], line, *lines[3:], b""]))
    with pytest.raises(BadInput, match=f"{path}, line 3: is damaged; delete the file"):
        Journal(result, "mine", resume=True)


def test_a_folder_that_is_missing_is_named_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"cannot write the journal .*: No such file or directory"):
        Journal(tmp_path / "missing" / "result.json", "mine", resume=False)


def test_a_journal_taken_away_meanwhile_is_not_begun_again_without_its_first_line(result: Path) -> None:
    journal = written(result, 1)
    journal.path.unlink()
    with pytest.raises(BadInput, match=r"cannot write the journal .*result.json.partial: No such file"):
        journal.append("a", {})
    assert not journal.path.exists()


def test_it_is_gone_when_its_work_is_done(result: Path) -> None:
    journal = written(result, 2)
    journal.remove()
    journal.remove()
    assert list(result.parent.iterdir()) == []
