"""Importing this lets BLAS work with one thread, as the commands do; it has to come before numpy."""

from __future__ import annotations

import os

from viewsep.cli import ONE_THREAD

os.environ.update(ONE_THREAD | os.environ)
