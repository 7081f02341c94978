"""pybullet, imported without its build banner, which would spoil the output of programs."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from viewsep.errors import ViewsepError


def load_pybullet() -> ModuleType:
    """The pybullet module. Raises ViewsepError where it is not installed (it has wheels for CPython 3.11 only)."""
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"]
    try:
        with _silent_c_output():
            import pybullet
    except ImportError as error:
        raise ViewsepError(
            "the simulation needs pybullet, which has wheels for CPython 3.11 only: run viewsep with Python 3.11"
        ) from error
    module: ModuleType = pybullet
    return module


@contextmanager
def _silent_c_output() -> Iterator[None]:
    """Nothing reaches stdout or stderr, C code's buffers included."""
    sys.stdout.flush()
    sys.stderr.flush()
    c_library = ctypes.CDLL(None)
    saved = [os.dup(descriptor) for descriptor in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor in (1, 2):
            os.dup2(nowhere, descriptor)
        yield
    finally:
        c_library.fflush(None)  # what C has buffered would come out later
        for descriptor, copy in zip((1, 2), saved, strict=True):
            os.dup2(copy, descriptor)
            os.close(copy)
        os.close(nowhere)
