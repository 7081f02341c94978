"""What commands import, and Ctrl-C meanwhile."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("scipy", "pybullet", "matplotlib", "joblib", "viewsep.bench", "viewsep.sim", "viewsep.engine")
INTERRUPTED = """
import os, signal, sys

when, sys.argv = sys.argv[1], ["viewsep", "stop", "--help"]

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == when:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupt())
from viewsep.cli import main
main()
"""


def python(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("module", ["status", "requests", "rigs"])
def test_a_client_does_not_import_what_only_others_need(module: str) -> None:
    program = f"import sys, viewsep.cli.app, viewsep.cli.{module}; print(*(m for m in {HEAVY} if m in sys.modules))"
    ran = python(program)
    assert (ran.stdout, ran.stderr) == ("\n", "")


@pytest.mark.parametrize("when", ["viewsep.cli.app", "typer", "viewsep.cli.requests", "viewsep.client", "zenoh"])
def test_ctrl_c_while_a_command_starts_leaves_no_traceback(when: str) -> None:
    ran = python(INTERRUPTED, when)
    assert ran.returncode == 130
    assert ran.stdout == ""
    assert "Traceback" not in ran.stderr
