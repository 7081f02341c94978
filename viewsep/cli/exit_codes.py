"""Exit codes of commands whose task has ended; errors have those of `viewsep.errors`."""

from __future__ import annotations

from viewsep.messages import Outcome

EXIT_CODES = {
    Outcome.IDENTIFIED: 0,
    Outcome.UNDECIDED: 3,
    Outcome.FAILED: 4,
    Outcome.UNKNOWN: 6,
    Outcome.INDISTINGUISHABLE: 7,
}
EXIT_WRONG = 5
EXIT_INTERRUPTED = 130
