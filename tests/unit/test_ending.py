"""A process that is asked to end, by many signals at once or by an error."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest

from viewsep.errors import ViewsepError
from viewsep.service.ending import Ending

WAITS = """
from viewsep.service.ending import Ending
ending = Ending()
ending.on_signals()
print("waiting", flush=True)
ending.wait()
for _ in range(2000):
    ending.ask()  # signals come while the end is asked for
print("ended", flush=True)
input()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_any_number_of_signals_at_once_end_it(number: int) -> None:
    process = subprocess.Popen([sys.executable, "-c", WAITS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "waiting\n"
    for _ in range(300):
        os.kill(process.pid, number)
    assert process.communicate("\n", timeout=20)[0] == "ended\n"
    assert process.returncode == 0


def test_it_is_asked_for_from_another_thread() -> None:
    ending = Ending()
    threading.Timer(0.05, ending.ask).start()
    ending.wait()


def test_an_error_is_the_reason() -> None:
    ending = Ending()
    ending.ask(ZeroDivisionError("by zero"))
    ending.ask()
    with pytest.raises(ViewsepError, match="ended by a bug, ZeroDivisionError: by zero"):
        ending.wait()
