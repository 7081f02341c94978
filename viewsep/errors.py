"""The errors viewsep raises on purpose.

Every one of them is a sentence for a person: it names the file, key or joint, the value, and the remedy.
The command line prints it as it is and exits with `exit_code`; anything else that escapes is a bug.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable


class ViewsepError(Exception):
    """Base of all deliberate errors."""

    exit_code = 1


class BadInput(ViewsepError):
    """The user's input cannot be used: an unknown config key, a candidate that is not in the library."""

    exit_code = 2


class BadMesh(BadInput):
    """A mesh file cannot be rendered as it should look: no material, missing texture, NaN, no faces."""


class BadModel(BadInput):
    """A model file is damaged, of another schema version, or was learned with another descriptor."""


class BadConfig(BadInput):
    """A configuration file or option has an unknown key, a wrong type or a value out of range."""


class BadRecording(BadInput):
    """A recording is damaged, truncated, or was made with other models than it claims."""


class ReplayMismatch(ViewsepError):
    """The engine did not repeat what was recorded; names the first difference."""


class RigError(ViewsepError):
    """Base of everything that goes wrong at the motion or the camera."""


class NotConnected(RigError):
    """A device was used before `connect()` or after `close()`."""


class MoveRefused(RigError):
    """A set-point lies outside the limits of a joint, or the backend is in a fault state."""


class Timeout(RigError):
    """A wait passed its deadline: no frame from the camera, no read-back from the motors, a move that never settled."""


class UnreachableView(RigError):
    """A view direction was asked for that no joint angles within the limits show."""


class LeaseLost(RigError):
    """Whoever was allowed to move the rig no longer is: it was stopped by somebody, or another one has taken it."""


class RigLost(RigError):
    """The process that holds the rig has not answered for too long."""


class Interrupted(ViewsepError):
    """Somebody stopped a long run (Ctrl-C, SIGTERM); says what is kept of it and how to go on."""

    exit_code = 130


def try_all(acts: Iterable[Callable[[], None]]) -> None:
    """Do all of them, whatever goes wrong, then raise the first error: how devices are stopped and released."""
    errors: list[BaseException] = []
    for act in acts:
        try:
            act()
        except BaseException as error:
            errors.append(error)
    if errors:
        raise errors[0]
