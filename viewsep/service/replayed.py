"""A recording played as if it were live: published on a rig's keys, with a status, and nothing that moves."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import zenoh
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.timestamp_pb2 import Timestamp

from viewsep.config import ServiceConfig
from viewsep.errors import BadConfig, BadInput
from viewsep.recordings.build import this_build
from viewsep.recordings.codec import IMAGE_TOPIC, RecordedFrame, serialise
from viewsep.recordings.pacing import Item, Playback
from viewsep.recordings.reader import Recording
from viewsep.service.answering import declare_answer, declare_refusals
from viewsep.service.calls import CALLS
from viewsep.service.manifest import manifest
from viewsep.service.names import ENGINE_STREAMS, RIG_STREAMS, Keys, Role
from viewsep.service.presence import Presence
from viewsep.service.requests import REQUESTS, Code, Refused
from viewsep.service.shown import Shown
from viewsep.service.status import Status
from viewsep.service.streams import LogStream, Streams
from viewsep.service.transport import Connections, NoAnswer, client_session, logged, parse_endpoint, serving_session

log = logging.getLogger("viewsep.service")
Wait = Callable[[float], bool | None]
"""Sleeps for so many seconds; True, at once, when it is time to stop."""
LOOK_S = 1.0  # for others of the same name behind an endpoint
POLL_S = 0.02
SETTLED_S = 0.3  # a viewer subscribes to one stream after the other
LINGER_S = 2.0


class ReplayedRig:
    """A recording that looks like a served rig. A context manager: within, it is seen by clients and can be played.

    What is published has the bytes of the recording: the streams by the same rules as a live rig's, pictures as they
    were compressed. Every request is refused. Entering raises BadInput where a rig of that name is already there.
    """

    def __init__(self, service: ServiceConfig, recording: Recording, file: Path, playback: Playback) -> None:
        self.keys = Keys(service.name)
        self._service = service
        self._file = file
        self._playback = playback
        self._shown = Shown(recording, file, playback)
        self._build = this_build()
        self._streams: dict[str, Streams] = {}  # by topic
        self._present: Callable[[], tuple[str, ...]] = tuple
        self._connected: Callable[[], tuple[str, ...]] = tuple
        self._open = ExitStack()

    def __enter__(self) -> ReplayedRig:
        try:
            self._begin()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Undeclare everything and close the sessions. Safe to call twice."""
        stack, self._open = self._open, ExitStack()
        stack.close()

    def play(self) -> Iterator[Item]:
        """Publish everything when it is due, until the end or a stop; each item right after it was published."""
        self._shown.begin()
        log.info("%s is played as %s", self._file, self._shown.task)
        for item in self._playback:
            self._publish(item)
            self._shown.hear(item)
            yield item
        if self._playback.stopped:
            return
        result = self._shown.end()
        log.info("task %s: %s", result.task, result.account.sentence)

    def watched(self) -> frozenset[str]:
        """The topics that somebody subscribes to."""
        return frozenset().union(*(streams.watched() for streams in set(self._streams.values())))

    def wait_for_viewers(self, timeout_s: float, wait: Wait = time.sleep) -> bool:
        """Wait until somebody subscribes, and to nothing more for a moment; False when nobody does in time."""
        deadline = time.monotonic() + timeout_s
        seen, since = self.watched(), time.monotonic()
        while not seen or time.monotonic() < since + SETTLED_S:
            if wait(POLL_S) or (not seen and time.monotonic() >= deadline):
                return False
            if (now := self.watched()) != seen:
                seen, since = now, time.monotonic()
        return True

    def linger(self, wait: Wait = time.sleep) -> None:
        """Stay until everybody has gone, but not for long: viewers fetch what came last and ask how it ended."""
        deadline = time.monotonic() + LINGER_S
        while self._connected() and time.monotonic() < deadline and not wait(POLL_S):
            pass

    def status(self) -> Status:
        """As a live rig and engine would answer, and that it is a replay."""
        return Status(
            name=self.keys.rig,
            alive=self._present(),
            build=self._build,
            unix_ns=time.time_ns(),
            rig=self._shown.rig(self._connected()),
            engine=self._shown.engine(),
            replay=self._shown.replay(),
        )

    def _begin(self) -> None:
        """Open from the inside out; what was opened last is closed first."""
        service, stack = self._service, self._open
        session = self._session()
        images = serving_session(service, service.listen_images, service.connect_images)
        stack.callback(images.close)
        connections, viewers = Connections(session, logged("control")), Connections(images, logged("images"))
        stack.callback(connections.undeclare)
        stack.callback(viewers.undeclare)
        self._connected = lambda: tuple(sorted((*connections.names, *viewers.names)))
        roles = Presence(session, self.keys.alive("*"), lambda _role: None)
        stack.callback(roles.close)
        self._present = roles.names
        self._open_streams(images, (IMAGE_TOPIC,))
        for role, topics in ((Role.ENGINE, ENGINE_STREAMS), (Role.RIG, RIG_STREAMS)):
            handler = LogStream(self._open_streams(session, topics), role, whole_process=role is Role.RIG)
            log.addHandler(handler)
            stack.callback(log.removeHandler, handler)
        self._shown.begin()  # before anybody can ask
        self._answer(session)
        for role in Role:
            stack.callback(session.liveliness().declare_token(self.keys.alive(role)).undeclare)

    def _session(self) -> zenoh.Session:
        """The session of everything but pictures. Raises BadInput when it cannot listen or the name is taken."""
        service = self._service
        try:
            session = serving_session(service, service.listen, service.connect)
        except BadConfig:
            raise
        except BadInput:
            self._check_free(service.listen, "on another endpoint (service.listen in --config)")
            raise
        self._open.callback(session.close)
        self._check_free(service.connect, "under another --name")
        return session

    def _check_free(self, endpoints: Sequence[str], remedy: str) -> None:
        """Raises BadInput when our name is taken behind one of the endpoints; those that do not answer are free."""
        for endpoint in endpoints:
            roles = _roles(self._service, self.keys, endpoint)
            if roles:
                raise BadInput(
                    f"rig {self.keys.rig!r} is already served at {endpoint} ({', '.join(roles)}): end it, or play "
                    f"the recording {remedy}"
                )

    def _open_streams(self, session: zenoh.Session, topics: Sequence[str]) -> Streams:
        streams = Streams(session, self.keys, topics)
        self._open.callback(streams.close)
        self._streams |= dict.fromkeys(topics, streams)
        return streams

    def _answer(self, session: zenoh.Session) -> None:
        """Declare everything that can be asked for; an engine elsewhere is refused its calls as everybody is."""
        pictures = (*self._service.connect_images, *self._service.listen_images)
        answers = {
            self.keys.status: lambda _: self.status().to_json(),
            self.keys.manifest: lambda _: manifest(self.keys, pictures),
            **{self.keys.command(name): self._refuse for name in REQUESTS},
            **{self.keys.remote(name): self._refuse for name in CALLS},
        }
        for key, answer in answers.items():
            self._open.callback(declare_answer(session, key, answer).undeclare)
        self._open.callback(declare_refusals(session, self.keys.command("*")).undeclare)

    def _refuse(self, _: bytes) -> bytes:
        raise Refused(
            Code.REPLAY,
            f"rig {self.keys.rig!r} is a replay of {self._file}: there is nothing to move and no task to start or end",
        )

    def _publish(self, item: Item) -> None:
        """With the bytes of the recording; what a live rig does not publish is left out."""
        if isinstance(item, RecordedFrame):
            self._streams[IMAGE_TOPIC].put(IMAGE_TOPIC, item.stamp_ns, _picture(item))
        elif item.topic in self._streams:
            self._streams[item.topic].put(item.topic, item.stamp_ns, item.raw)


def _picture(frame: RecordedFrame) -> bytes:
    """The picture as it was recorded, not compressed again."""
    stamp = Timestamp(seconds=frame.stamp_ns // 1_000_000_000, nanos=frame.stamp_ns % 1_000_000_000)
    return serialise(CompressedImage(timestamp=stamp, data=frame.jpeg, format="jpeg"))


def _roles(service: ServiceConfig, keys: Keys, endpoint: str) -> tuple[str, ...]:
    """The roles of the rig that are served behind an endpoint, none where nobody answers."""
    if parse_endpoint(endpoint, "service.connect").port == 0:
        return ()
    folder = Path(service.keys) if service.keys else None
    try:
        session = client_session((endpoint,), folder, service.certificate, LOOK_S)
    except NoAnswer:
        return ()
    try:
        replies = session.liveliness().get(keys.alive("*"), timeout=LOOK_S)
        return tuple(sorted(str(reply.ok.key_expr).rsplit("/", 1)[1] for reply in replies if reply.ok is not None))
    finally:
        session.close()
