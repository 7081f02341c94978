"""The engine's end of the calls to a rig: asked again until they are answered, and the rig's clock from round trips."""

from __future__ import annotations

import itertools
import json
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import zenoh

from viewsep.errors import LeaseLost, RigError, RigLost, ViewsepError
from viewsep.service.calls import error_from
from viewsep.service.names import JSON, Keys

ANSWER_S = 1.0  # for a call that does not wait for anything at the rig
ASK_AGAIN_S = 0.1
BEAT_S = 0.5  # between two signs of life, or less where the lease is short
BEATS_PER_LEASE = 4
FIRST_SAMPLES = 8
SAMPLES = 10  # of the clock; the one with the shortest round trip counts

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Sample:
    round_trip_ns: int
    local_ns: int  # half-way
    rig_ns: int


class ClockEstimate:
    """The rig's clock as a function of this machine's: `speed` times as fast, set by the best of the last round trips.

    It is wrong by at most half that round trip, times the speed.
    """

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self._samples: deque[_Sample] = deque(maxlen=SAMPLES)

    def hear(self, sent_ns: int, received_ns: int, rig_ns: int) -> None:
        """A call sent and answered at these local times was answered at `rig_ns` of the rig's clock."""
        self._samples.append(_Sample(received_ns - sent_ns, (sent_ns + received_ns) // 2, rig_ns))

    def at(self, local_ns: int) -> int:
        """The rig's clock at a local time. Raises RigError before the first round trip."""
        best = self._best()
        if best is None:
            raise RigError("the rig's clock is not known: it has answered no call yet")
        return best.rig_ns + round((local_ns - best.local_ns) * self.speed)

    @property
    def offset_s(self) -> float | None:
        """The rig's clock minus this machine's when it was measured; None before, or for a clock that is stepped."""
        best = self._best()
        return None if best is None or self.speed == 0.0 else (best.rig_ns - best.local_ns) * 1e-9

    @property
    def round_trip_s(self) -> float | None:
        """The shortest of the last round trips."""
        best = self._best()
        return None if best is None else best.round_trip_ns * 1e-9

    def _best(self) -> _Sample | None:
        return min(tuple(self._samples), key=lambda sample: sample.round_trip_ns, default=None)


class RigLink:
    """Calls to the rig under `viewsep/{rig}/rig/…`, for any number of threads.

    A call without an answer is sent again until `resume_s` have passed, so whoever asks waits while the link is down;
    a repetition has the number of the first, and the rig does nothing twice. Then RigLost is raised, and from then on
    calls are tried once, until one is answered. From `open` to `close` a thread gives signs of life, which renew the
    lease of `holder` and measure the clock, also while the engine thinks.
    """

    def __init__(self, session: zenoh.Session, keys: Keys, *, resume_s: float = 10.0) -> None:
        self._session = session
        self._keys = keys
        self._resume_s = resume_s
        self._caller = uuid.uuid4().hex
        self._numbers = itertools.count()
        self._instance = ""
        self._patient = True
        self._beat_s = BEAT_S
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self.holder = ""
        self.up = False
        self.clock = ClockEstimate(1.0)

    @property
    def clock_offset_s(self) -> float | None:
        """The rig's clock minus this machine's; None while it is not measured."""
        return self.clock.offset_s

    @property
    def round_trip_s(self) -> float | None:
        """The shortest of the last round trips; None while it is not measured."""
        return self.clock.round_trip_s

    def open(self) -> None:
        """Begin to give signs of life."""
        self._closing.clear()
        self._thread = threading.Thread(target=self._beat, name="viewsep rig link", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End; a call that still waits for an answer raises RigLost. Safe to call twice, before the session closes."""
        self._closing.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()

    def follow_clock(self, speed: float, lease_s: float) -> None:
        """Measure a clock that runs at `speed`, and give signs of life often enough for a lease. Raises RigLost."""
        self._beat_s = min(BEAT_S, lease_s / BEATS_PER_LEASE)
        self.clock = ClockEstimate(speed)
        for _ in range(FIRST_SAMPLES):
            self._sign_of_life()

    def acquire(self, holder: str) -> None:
        """Take the lease and keep it. Raises Refused (busy), RigLost, RigError."""
        self.ask("acquire", holder=holder)
        self.holder = holder

    def release(self, holder: str) -> None:
        """Give the lease back; the motion is stopped. Raises RigLost, RigError."""
        self.holder = ""
        self.ask("release", holder=holder)

    def wall_s(self, rig_s: float) -> float:
        """How long the rig takes for a time on its clock; a stepped one takes none."""
        return rig_s / self.clock.speed if self.clock.speed > 0.0 else 0.0

    def call(self, name: str, read: Callable[[Any], T], **arguments: Any) -> T:
        """What `read` finds in the JSON reply. Raises what the rig's side raised, RigLost, RigError."""
        return _read(name, self.ask(name, **arguments), read)

    def ask(self, name: str, wait_s: float = 0.0, **arguments: Any) -> bytes:
        """The reply's bytes. `wait_s` is what the call itself may take. Raises what the rig's side raised, RigLost."""
        payload = self._payload(**arguments)
        patience_s, begun_s = self._resume_s if self._patient else 0.0, time.monotonic()
        while True:
            reply = self._attempt(name, payload, ANSWER_S + wait_s)
            if isinstance(reply, ViewsepError):
                raise reply
            if reply is not None:
                return reply
            if time.monotonic() - begun_s >= patience_s:
                self._patient, self.holder = False, ""
                raise RigLost(
                    f"rig {self._keys.rig!r} has not answered for {self._resume_s:g} s: check that it is served and "
                    "that the network is up"
                )
            if self._closing.wait(ASK_AGAIN_S):
                raise RigLost(f"rig {self._keys.rig!r} did not answer before the link to it was closed")

    def _attempt(self, name: str, payload: bytes, timeout_s: float) -> bytes | ViewsepError | None:
        """Reply, error, or None when there was none in time. Raises RigLost when there is no session any more."""
        try:
            for reply in self._session.get(self._keys.remote(name), payload=payload, timeout=timeout_s):
                if reply.ok is not None:
                    self.up = self._patient = True
                    return reply.ok.payload.to_bytes()
                if reply.err is not None and str(reply.err.encoding) == JSON:  # else Zenoh's own: a timeout
                    self.up = self._patient = True
                    return error_from(reply.err.payload.to_bytes())
        except zenoh.ZError as error:
            raise RigLost(f"rig {self._keys.rig!r} cannot be asked: {error}") from error
        self.up = False
        return None

    def _payload(self, **arguments: Any) -> bytes:
        return json.dumps({"caller": self._caller, "number": next(self._numbers), **arguments}).encode()

    def _beat(self) -> None:
        while not self._closing.wait(self._beat_s):
            try:
                self._sign_of_life()
            except RigError:  # the next call tells what is wrong
                self.up = False

    def _sign_of_life(self) -> None:
        estimate, holder = self.clock, self.holder
        payload, sent_ns = self._payload(holder=holder), time.monotonic_ns()
        reply = self._attempt("clock", payload, ANSWER_S)
        received_ns = time.monotonic_ns()
        if isinstance(reply, LeaseLost) and self.holder == holder:
            self.holder = ""  # the next call tells whoever held it
        if isinstance(reply, bytes):
            instance, rig_ns = _read("clock", reply, lambda said: (str(said["instance"]), int(said["now_ns"])))
            if instance != self._instance:  # another process, another clock
                self._instance, estimate = instance, ClockEstimate(estimate.speed)
            estimate.hear(sent_ns, received_ns, rig_ns)
            self.clock = estimate


def _read(name: str, reply: bytes, read: Callable[[Any], T]) -> T:
    try:
        return read(json.loads(reply))
    except (ValueError, KeyError, TypeError) as error:
        raise RigError(
            f"the rig's reply to {name!r} cannot be read ({error!r}): does it run the same version of viewsep?"
        ) from error
