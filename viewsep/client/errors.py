"""What can go wrong between a client and a service."""

from __future__ import annotations

from viewsep.errors import BadInput, ViewsepError
from viewsep.service.requests import Code

BAD_REQUESTS = frozenset(
    {
        Code.BAD_JSON,
        Code.BAD_REQUEST,
        Code.UNKNOWN_COMMAND,
        Code.TOO_LARGE,
        Code.UNKNOWN_MODEL,
        Code.NO_MODELS,
        Code.UNREACHABLE,
    }
)
"""Refusals for which the request itself is to blame; all others depend on the state of the rig."""


class RequestRefused(ViewsepError):
    """The service did not carry out a request, in its own words; `code` is one of `viewsep.service.requests.Code`."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
        self.exit_code = BadInput.exit_code if code in BAD_REQUESTS else ViewsepError.exit_code


class NoAnswer(ViewsepError):
    """Nobody answered within the timeout: the service does not run, or its keys do not allow this client."""


class BadReply(ViewsepError):
    """An answer that this client cannot read: damaged, or of another version."""


class TaskLost(ViewsepError):
    """The service does not know the task any more, nor how it ended."""
