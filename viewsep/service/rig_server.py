"""Answers the remote calls under `viewsep/{rig}/rig/…`: the rig's interfaces for another process."""

from __future__ import annotations

import json
import threading
import uuid
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict
from typing import Any

import numpy as np
import zenoh

from viewsep.calibration.compensation import compensated
from viewsep.interfaces import Look, MotionBackend
from viewsep.messages import Array, FloatArray
from viewsep.perception import RigPerception
from viewsep.perception.setup import finder_of
from viewsep.plugins import make_descriptor
from viewsep.service.calls import (
    MAX_WAIT_S,
    READ_ONLY,
    WAITING,
    Call,
    FrameCall,
    HistoryCall,
    LookCall,
    MoveCall,
    SleepCall,
    error_reply,
    parse_call,
)
from viewsep.service.looks import encode_look, encode_picture
from viewsep.service.names import JSON, Keys
from viewsep.service.requests import Code, Refused
from viewsep.service.served_rig import RIG_SECTIONS, ServedRig
from viewsep.session import Rig

WORKERS = 4  # calls that wait at the same time
REMEMBERED = 16  # replies, for calls that are repeated because the reply was lost


class RigServer:
    """Answers calls on a rig from `open` to `close`.

    Zenoh runs one queryable's callbacks one after the other on a thread of its own: short calls are answered there, so
    they keep their order; those that wait go to a few threads. A repeated call gets the reply to the first one.
    """

    def __init__(self, session: zenoh.Session, keys: Keys, served: ServedRig) -> None:
        self._session = session
        self._keys = keys
        self._served = served
        self._instance = uuid.uuid4().hex
        self._perception = _Perceptions(served)
        self._waiting = ThreadPoolExecutor(WORKERS, "viewsep rig call")
        self._lock = threading.Lock()
        self._replies: OrderedDict[tuple[str, int], Future[bytes]] = OrderedDict()
        self._queryable: zenoh.Queryable[None] | None = None

    def open(self) -> None:
        """Begin to answer. Raises zenoh.ZError."""
        self._queryable = self._session.declare_queryable(self._keys.remote("*"), self._receive, complete=True)

    def close(self) -> None:
        """Answer what was asked, then no more; closing the camera first frees those who wait for a frame.

        Safe to call twice; before the session is closed, from no callback.
        """
        queryable, self._queryable = self._queryable, None
        if queryable is not None:
            queryable.undeclare()
        self._waiting.shutdown(wait=True, cancel_futures=True)

    def _receive(self, query: zenoh.Query) -> None:
        name = str(query.key_expr).rpartition("/")[2]
        if name not in WAITING:
            self._answer(name, query)
            return
        try:
            self._waiting.submit(self._answer, name, query)
        except RuntimeError:  # the threads are gone
            self._refuse(name, query, Refused(Code.UNAVAILABLE, "the rig is shutting down: ask again later"))

    def _answer(self, name: str, query: zenoh.Query) -> None:
        try:
            payload = query.payload
            reply = self._reply_to(name, b"" if payload is None else payload.to_bytes())
        except Exception as error:
            self._refuse(name, query, error)
            return
        with query, suppress(zenoh.ZError):  # whoever asked may have gone
            query.reply(query.key_expr, reply)

    def _refuse(self, name: str, query: zenoh.Query, error: Exception) -> None:
        with query, suppress(zenoh.ZError):
            query.reply_err(error_reply(name, error), encoding=JSON)

    def _reply_to(self, name: str, payload: bytes) -> bytes:
        """The reply; that of the first time when the call is a repetition. Raises what goes wrong."""
        call = parse_call(name, payload)
        if name in READ_ONLY:
            return self._carry_out(name, call)
        key = call.caller, call.number
        with self._lock:
            reply = self._replies.get(key)
            first = reply is None
            if reply is None:
                reply = self._replies[key] = Future()
                if len(self._replies) > REMEMBERED:
                    self._replies.popitem(last=False)
        if first:
            try:
                reply.set_result(self._carry_out(name, call))
            except BaseException as error:
                reply.set_exception(error)
        return reply.result()

    def _carry_out(self, name: str, call: Call) -> bytes:
        match call:
            case LookCall():
                self._renew(call)
                look = self._perception.look(call)
                return encode_look(look, call.send, self._served.camera.drops)
            case FrameCall():
                self._renew(call)
                frame = self._served.camera.read(call.newer_than_ns, call.timeout_s)
                return encode_picture(frame, self._served.camera.drops)
            case SleepCall():
                self._renew(call)
                return _json(now_ns=self._sleep(call.until_ns))
            case MoveCall():
                return _json(commanded_rad=self._motion(call).move_to(call.position_rad))
            case HistoryCall():
                return _json(states=[asdict(state) for state in self._motion(call).history(call.since_ns)])
            case _:
                return self._plain(name, call)

    def _plain(self, name: str, call: Call) -> bytes:
        """Calls without arguments."""
        motion, clock = self._motion(call), self._served.clock
        match name:
            case "describe":
                return self._describe()
            case "clock":
                self._renew(call)
                return _json(now_ns=clock.now_ns(), instance=self._instance)
            case "acquire":
                motion.connect()
                return _json()
            case "release":
                motion.close()
                return _json()
            case "state":
                return _json(state=asdict(motion.read_state()))
            case "stop":
                motion.stop()
                return _json()
            case "fault":
                return _json(fault=motion.fault())
            case "clear_fault":
                motion.clear_fault()
                return _json()
            case "temperatures":
                return _json(temperatures_c=motion.temperatures_c())
            case "counters":
                return _json(counters=dict(motion.counters()))
            case _:
                raise AssertionError(f"call {name!r} has no answer")

    def _describe(self) -> bytes:
        served = self._served
        return _json(
            instance=self._instance,
            **served.config.model_dump(mode="json", include=set(RIG_SECTIONS)),
            limits=[asdict(limit) for limit in served.motion.limits()],
            speed=served.speed,
            lease_s=served.motion.lease.lease_s,
            simulated=served.simulated,
            holds=served.holds,
            pictures=served.pictures,
        )

    def _motion(self, call: Call) -> MotionBackend:
        return self._served.motion.commanded_by(call.holder) if call.holder else self._served.motion

    def _renew(self, call: Call) -> None:
        if call.holder:
            with self._served.motion.used_by(call.holder):
                pass

    def _sleep(self, until_ns: int) -> int:
        clock = self._served.clock
        if self._served.speed > 0.0:
            raise Refused(Code.BAD_REQUEST, "sleep: this rig's time passes by itself: wait for it")
        if until_ns > clock.now_ns() + round(MAX_WAIT_S * 1e9):
            raise Refused(Code.BAD_REQUEST, f"sleep: until_ns is more than {MAX_WAIT_S:g} s ahead: go there in steps")
        clock.sleep_until(until_ns)
        return clock.now_ns()


class _Perceptions:
    """Looks with the descriptor that the engine uses."""

    def __init__(self, served: ServedRig) -> None:
        rig = Rig(served.motion, served.camera, served.geometry, served.clock)
        self._rig = compensated(rig, served.config)
        self._finder = finder_of(served.config)  # it remembers from look to look
        self._pairing = RigPerception(self._rig, _PairingOnly(), self._finder)

    def look(self, call: LookCall) -> Look:
        """Raises Timeout, BadConfig."""
        if call.send != "descriptor":
            return self._pairing.look(call.newer_than_ns, call.timeout_s)
        perception = RigPerception(self._rig, make_descriptor(call.descriptor), self._finder)
        return perception.look(call.newer_than_ns, call.timeout_s)


class _PairingOnly:
    """A `Descriptor` without a feature, where the engine's side makes it: the rig's tells the view direction."""

    name = ""
    size = 0

    @property
    def parameters(self) -> dict[str, float | int | str]:
        return {}

    def describe(self, image: Array, mask: Array | None) -> Array:
        return np.zeros(0, np.float32)

    def similarity(self, feature: Array, features: Array) -> FloatArray:
        return np.zeros(len(features))


def _json(**said: Any) -> bytes:
    return json.dumps(said).encode()
