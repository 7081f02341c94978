"""The same rows whoever works them off; a run that is stopped, killed or fails loses nothing and leaves nobody."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import slow_rows
from dask_cluster import PATIENCE_S, dask_cluster
from slow_rows import row, row_or_bug, row_or_death, row_or_error

from viewsep.bench.cluster import connected
from viewsep.bench.journal import Journal, Row
from viewsep.bench.runner import Call, Workers, run_calls
from viewsep.errors import BadInput, BadMesh, Interrupted, ViewsepError

EXPERIMENT = Path(slow_rows.__file__)
COUNT = 14


def calls(count: int = COUNT) -> list[Call]:
    """The first one takes longest."""
    return [Call(f"row {number}", row, (number, 0.5 if number == 0 else 0.0)) for number in range(count)]


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.02)


def is_gone(pid: int) -> bool:
    """Whether a process has ended; one that nobody has collected yet has."""
    state = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False).stdout
    return not state.strip() or state.startswith("Z")


def started(trace: Path) -> list[tuple[int, int]]:
    """Number and process of every call that was begun."""
    names = [path.name.split("-") for path in trace.iterdir()] if trace.is_dir() else []
    return [(int(number), int(pid)) for number, pid, _ in names]


def lines(result: Path) -> int:
    journal = result.with_name(f"{result.name}.partial")
    return len(journal.read_bytes().splitlines()) if journal.exists() else 0


@pytest.fixture
def experiment(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts the experiment in a process group of its own, as a shell does."""
    with ExitStack() as stack:

        def start(jobs: int, *options: str) -> subprocess.Popen[str]:
            command = [sys.executable, str(EXPERIMENT), str(tmp_path / "result.json"), str(jobs), str(COUNT), *options]
            process = subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True)
            stack.enter_context(process)
            stack.callback(process.kill)
            return process

        yield start


def test_rows_are_in_the_order_of_the_calls_and_the_same_for_any_number_of_jobs() -> None:
    heard: list[Row] = []
    alone = run_calls(calls(), Workers(1))
    assert run_calls(calls(), Workers(2), on_row=heard.append) == alone
    assert [row["number"] for row in alone] == list(range(COUNT))
    assert heard[0]["number"] != 0  # it came later and stands first
    assert sorted(row["number"] for row in heard) == list(range(COUNT))
    assert {row["threads"] for row in alone} == {1}


def test_rows_are_what_json_makes_of_them() -> None:
    (only,) = run_calls(calls(1), Workers(1))
    assert only["pair"] == [1, 2]
    assert json.loads(json.dumps(only)) == only


def test_nothing_to_do_is_done() -> None:
    assert run_calls([], Workers(2)) == []


def test_rows_of_the_journal_are_taken_as_they_are(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "result.json", "mine", resume=False)
    journal.append("row 1", {"number": "kept"})
    heard: list[Row] = []
    rows = run_calls(calls(3), Workers(1), journal, heard.append)
    assert [row["number"] for row in rows] == [0, "kept", 2]
    assert [row["number"] for row in heard] == ["kept", 0, 2]
    assert list(Journal(tmp_path / "result.json", "mine", resume=True).rows) == ["row 1", "row 0", "row 2"]


def test_two_calls_with_one_key_are_a_mistake_of_the_program() -> None:
    with pytest.raises(ValueError, match="two calls have the same key"):
        run_calls([*calls(2), *calls(1)], Workers(1))


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_keeps_its_kind_and_sentence_and_ends_the_rest(jobs: int, tmp_path: Path) -> None:
    journal = Journal(tmp_path / "result.json", "mine", resume=False)
    (tmp_path / "trace").mkdir()
    failing = [Call(str(number), row_or_error, (number, tmp_path / "trace")) for number in range(40)]
    with pytest.raises(BadMesh, match=r"^cracker.obj: has no faces; export it again$"):
        run_calls(failing, Workers(jobs), journal)
    begun = started(tmp_path / "trace")
    assert len(begun) < 12
    wait_until(lambda: all(is_gone(pid) for _, pid in begun if pid != os.getpid()))
    assert set(journal.rows) <= {str(number) for number, _ in begun}


def test_an_error_that_nobody_foresaw_comes_through() -> None:
    with pytest.raises(ZeroDivisionError):
        run_calls([Call(str(number), row_or_bug, (number,)) for number in range(3)], Workers(2))


def test_a_worker_that_dies_is_told_with_what_is_kept(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "result.json", "mine", resume=False)
    dying = [Call(str(number), row_or_death, (number, journal.path)) for number in range(4)]
    with pytest.raises(ViewsepError, match=r"a worker process died.*; 3 of 4 tasks are kept in .*partial: go on with"):
        run_calls(dying, Workers(2), journal)
    assert sorted(Journal(tmp_path / "result.json", "mine", resume=True).rows) == ["0", "1", "2"]


def test_a_run_that_was_killed_goes_on_where_it_was(
    experiment: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    result, trace = tmp_path / "result.json", tmp_path / "trace"
    killed = experiment(2)
    wait_until(lambda: lines(result) >= 4)
    killed.kill()
    killed.wait()
    wait_until(lambda: all(is_gone(pid) for _, pid in started(trace)))
    kept = Journal(result, "an experiment", resume=True).rows
    assert 3 <= len(kept) < COUNT
    resumed = experiment(2, "--resume")
    assert resumed.wait(PATIENCE_S) == 0
    fresh = run_calls([Call(str(number), row, (number,)) for number in range(COUNT)], Workers(1))
    assert result.read_text() == json.dumps(fresh)
    numbers = [f"row {number}" for number, _ in started(trace)]
    assert all(numbers.count(key) == 1 for key in kept)
    assert not result.with_name("result.json.partial").exists()


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("how", ["ctrl-c", "ctrl-c twice", "terminated"])
def test_a_run_that_is_stopped_says_so_and_keeps_what_is_done(
    how: str, jobs: int, experiment: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    result, trace = tmp_path / "result.json", tmp_path / "trace"
    process = experiment(jobs)
    wait_until(lambda: lines(result) >= 3)
    if how == "terminated":
        process.terminate()
    else:  # as a terminal does it: to everybody
        for _ in range(2 if how == "ctrl-c twice" else 1):
            os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE_S)
    kept = lines(result) - 1
    assert said == f"interrupted; {kept} of {COUNT} tasks are kept in {result}.partial: go on with --resume\n"
    assert process.returncode == Interrupted.exit_code == 130
    assert 2 <= kept < COUNT
    wait_until(lambda: all(is_gone(pid) for _, pid in started(trace)))
    assert not result.exists()


def test_ctrl_c_while_the_workers_start_is_as_quiet(
    experiment: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    process = experiment(2)
    wait_until(lambda: lines(tmp_path / "result.json") == 1)
    time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert said.startswith(f"interrupted; 0 of {COUNT} tasks are kept")
    assert said.count("\n") == 1


def test_what_a_stopped_run_leaves_is_cleared_away_quietly() -> None:
    leaving = (
        "from joblib.externals.loky.backend import resource_tracker as tracker\n"
        "from viewsep.bench.runner import _deaf_children\n"
        "with _deaf_children(): pass\n"
        "tracker.register('/viewsep-test-of-what-is-left', 'semlock')\n"
        "print(tracker._resource_tracker._pid)\n"
    )
    process = subprocess.run([sys.executable, "-c", leaving], capture_output=True, text=True, check=True, timeout=60)
    wait_until(lambda: is_gone(int(process.stdout)))
    assert process.stderr == ""


@pytest.mark.parametrize(
    ("workers", "message"),
    [
        ((0, ""), "--jobs 0: give a number of processes, or -1 for one per core"),
        ((-2, ""), "--jobs -2: give a number"),
        ((2, "tcp://127.0.0.1:8786"), "--jobs 2 counts local processes: leave it out with --scheduler"),
        (
            (-1, "127.0.0.1:8786"),
            "--scheduler '127.0.0.1:8786': give the address as the scheduler prints it, tcp://HOST",
        ),
        ((-1, "tcp://127.0.0.1"), "tcp://HOST:PORT"),
        ((-1, "tcp://127.0.0.1:port"), "tcp://HOST:PORT"),
        ((-1, "tcp://127.0.0.1:99999"), "tcp://HOST:PORT"),
        ((-1, "http://127.0.0.1:8786"), "tcp://HOST:PORT"),
        ((-1, "tcp://127.0.0.1:8786/status"), "tcp://HOST:PORT"),
    ],
)
def test_workers_that_make_no_sense_are_refused(workers: tuple[int, str], message: str) -> None:
    with pytest.raises(BadInput) as refusal:
        Workers(*workers)
    assert message in str(refusal.value)


def test_a_scheduler_needs_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BadInput, match=r"needs the packages dask and distributed: pip install 'viewsep\[cluster\]'"):
        run_calls(calls(1), Workers(scheduler="tcp://127.0.0.1:8786"))


def test_where_no_scheduler_answers_is_said_within_the_deadline() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(
            BadInput, match=rf"{address}: no Dask scheduler answers there \(nothing heard within 0.2 s\)"
        ):
            connected(address, 0.2).__enter__()
    with pytest.raises(
        BadInput, match=rf"{address}: no Dask scheduler answers there \(Connection refused\); start one"
    ):
        run_calls(calls(1), Workers(scheduler=address))


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    pytest.importorskip("distributed")
    with dask_cluster(tmp_path, EXPERIMENT.parent) as address:
        yield address


@pytest.mark.slow
def test_a_cluster_gives_the_same_rows_and_errors(scheduler: str, tmp_path: Path) -> None:
    with connected(scheduler) as client:
        client.wait_for_workers(2, timeout=PATIENCE_S)
    heard: list[Row] = []
    journal = Journal(tmp_path / "result.json", "mine", resume=False)
    rows = run_calls(calls(), Workers(scheduler=scheduler), journal, heard.append)
    assert rows == run_calls(calls(), Workers(1))
    assert heard[0]["number"] != 0
    assert len(journal.rows) == len(heard) == COUNT
    (tmp_path / "trace").mkdir()
    failing = [Call(str(number), row_or_error, (number, tmp_path / "trace")) for number in range(40)]
    with pytest.raises(BadMesh, match=r"^cracker.obj: has no faces; export it again$"):
        run_calls(failing, Workers(scheduler=scheduler))
    assert len({pid for _, pid in started(tmp_path / "trace")}) == 2
    assert len(started(tmp_path / "trace")) < 12
