"""The commands of docs/quickstart-hardware.md: all parse, and those for the emulated rig lead to the first answer."""

from __future__ import annotations

import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import typer
from ports import free_port
from shell import Shell

from viewsep.cli.app import app
from viewsep.config import load_config

DOCUMENT = (Path(__file__).parents[2] / "docs" / "quickstart-hardware.md").read_text(encoding="utf-8")
BLOCKS = [
    (words, block) for words, block in re.findall(r"^```sh *(\w*)\n(.*?)^```", DOCUMENT, re.DOTALL | re.MULTILINE)
]
COMMANDS = [line for _, block in BLOCKS for line in block.splitlines() if line.startswith("viewsep ")]
EMULATED = [line for words, block in BLOCKS if words == "emulated" for line in block.splitlines()]
SHORTER = (("--spacing 10", "--spacing 20"), ("background -c", "background --every-deg 10 -c"))
READY_WITHIN_S = 60.0


def test_there_are_commands_for_both_rigs() -> None:
    assert {words for words, _ in BLOCKS} == {"", "emulated"}
    assert len(EMULATED) >= 15
    assert len(COMMANDS) > len(EMULATED)


@pytest.mark.parametrize("typed", sorted(set(COMMANDS)))
def test_a_command_is_one_that_there_is(typed: str) -> None:
    command: Any = typer.main.get_command(app)
    words = shlex.split(typed.removesuffix("&"))
    above: Any = None
    name, *rest = words
    while True:
        above = command.make_context(name, rest, parent=above)  # raises for what it does not know
        if not hasattr(command, "commands"):
            break
        name, command, rest = command.resolve_command(above, [*above._protected_args, *above.args])
    assert above.params


@contextmanager
def beside(typed: str, folder: Path) -> Iterator[None]:
    """A command that goes on until it is interrupted, in a process of its own."""
    words = [sys.executable, "-m", "viewsep", *shlex.split(typed)[1:]]
    with subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL) as process:
        try:
            yield
        finally:
            process.send_signal(signal.SIGINT)
            assert process.wait(30.0) in (0, 130)


def wait_until(there: Callable[[], bool]) -> None:
    """Wait for what a command that goes on has to do first."""
    deadline_s = time.monotonic() + READY_WITHIN_S
    while not there():
        assert time.monotonic() < deadline_s
        time.sleep(0.2)


def shorter(typed: str) -> str:
    """The command with fewer views and pictures."""
    for long, short in SHORTER:
        typed = typed.replace(long, short)
    return typed


@pytest.mark.long
@pytest.mark.alone
@pytest.mark.needs_pybullet
def test_from_nothing_to_the_first_answer(shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As written, with fewer views and pictures; all in real time, as the servos are behind a port."""
    at = f"tcp/127.0.0.1:{free_port()}"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VIEWSEP_CONNECT", at)
    said: dict[str, str] = {}
    with ExitStack() as running:
        for line in EMULATED:
            typed = shorter(line)
            if typed.endswith("&"):
                running.enter_context(beside(typed.removesuffix("&"), tmp_path))
                emulates = "rig emulate" in typed
                wait_until(Path("servos").exists if emulates else lambda: shell("status").code == 0)
                continue
            words = shlex.split(typed)
            if words[0] != "viewsep":
                subprocess.run(words, check=True)
                continue
            del words[0]
            ended = shell(*words)
            assert ended.code == 0, f"{typed}: {ended.err}"
            said[typed] = f"{ended.out} {ended.err}"
            if words[:2] == ["rig", "init"]:
                with Path("rig.toml").open("a", encoding="utf-8") as file:
                    file.write(f'[service]\nlisten = ["{at}"]\nlisten_images = ["tcp/127.0.0.1:{free_port()}"]\n')
    assert "It is tea (right)" in said[next(typed for typed in said if "--truth tea" in typed)]
    assert "It is decaf (right)" in said[next(typed for typed in said if "--truth decaf" in typed)]
    assert "It is tea:" in said["viewsep watch"]
    assert load_config(Path("rig.toml")).rig.backlash_deg == pytest.approx([0.0], abs=0.5)
    assert Path("run.html").stat().st_size > 10_000
