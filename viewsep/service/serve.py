"""A serving process: Zenoh sessions, roles, streams, answers, and an end in good order."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import zenoh

from viewsep.config import Config
from viewsep.recordings.build import this_build
from viewsep.recordings.codec import IMAGE_TOPIC
from viewsep.recordings.queue import QueuedListener
from viewsep.service.answering import declare_answer, declare_refusals
from viewsep.service.ending import Ending
from viewsep.service.engine_role import EngineRole
from viewsep.service.leftovers import save_leftovers
from viewsep.service.manifest import manifest
from viewsep.service.names import ENGINE_STREAMS, RIG_STREAMS, Keys, Role
from viewsep.service.presence import Presence
from viewsep.service.remote import RemoteRig
from viewsep.service.requests import Refused, StopRequest, accepted, parse_request
from viewsep.service.rig_access import LocalAccess, RemoteAccess, RigAccess
from viewsep.service.rig_role import RigRole
from viewsep.service.rig_server import RigServer
from viewsep.service.served_rig import ServedRig
from viewsep.service.status import Status
from viewsep.service.streams import LogStream, Streams
from viewsep.service.transport import Connections, logged, serving_session

log = logging.getLogger("viewsep.service")


class Service:
    """One process of a service. A context manager: leaving it holds the position and closes everything.

    `served` is the rig of the role `rig`, None where this process has the role `engine` alone.
    """

    def __init__(self, config: Config, served: ServedRig | None, engine: bool, config_file: Path | None = None) -> None:
        if served is None and not engine:
            raise ValueError("a service without a role")
        self.keys = Keys(config.service.name)
        self._config = config
        self._config_file = config_file
        self._served = served
        self._with_engine = engine
        self._rig: RigRole | None = None
        self._engine: EngineRole | None = None
        self._build = this_build()
        self._present: Callable[[], tuple[str, ...]] = tuple
        self._open = ExitStack()
        self.ending = Ending()

    @property
    def roles(self) -> tuple[Role, ...]:
        """What this process does."""
        return tuple(
            role for role, has in ((Role.RIG, self._served is not None), (Role.ENGINE, self._with_engine)) if has
        )

    def __enter__(self) -> Service:
        try:
            self._begin()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def crash(self, error: Exception) -> None:
        """End the service with an error nobody expected; from any thread."""
        log.critical("the service ends: %s", error, exc_info=error)
        self.ending.ask(error)

    def close(self) -> None:
        """Hold the position, end the task, undeclare everything, close the sessions. Safe to call twice."""
        stack, self._open = self._open, ExitStack()
        stack.close()

    def _begin(self) -> None:
        """Open from the inside out; what was opened last is closed first."""
        settings, stack = self._config.service, self._open
        session = serving_session(settings, settings.listen, settings.connect)
        stack.callback(session.close)
        connections = Connections(session, logged("control"))
        stack.callback(connections.undeclare)
        owners = Presence(session, self.keys.lease("*"), self._owner_gone)
        roles = Presence(session, self.keys.alive("*"), self._role_gone)
        stack.callback(owners.close)
        stack.callback(roles.close)
        self._present = roles.names
        if self._served is not None:
            self._begin_rig(session, self._served, connections, owners)
        if self._with_engine:
            self._begin_engine(session, owners)
        self._answer(session)
        for role in self.roles:
            stack.callback(session.liveliness().declare_token(self.keys.alive(role)).undeclare)

    def _begin_rig(self, session: zenoh.Session, served: ServedRig, connections: Connections, owners: Presence) -> None:
        settings, stack = self._config.service, self._open
        images = serving_session(settings, settings.listen_images, settings.connect_images)
        stack.callback(images.close)
        viewers = Connections(images, logged("images"))
        stack.callback(viewers.undeclare)
        pictures = Streams(images, self.keys, (IMAGE_TOPIC,))
        stack.callback(pictures.close)
        streams = self._streams(session, Role.RIG, RIG_STREAMS)
        served.camera.on_frame(lambda frame: pictures.hear(frame.stamp_ns, frame))
        self._rig = RigRole(
            served,
            streams,
            self._config.task.move_timeout_s,
            self.crash,
            owners.arrived,
            lambda: tuple(sorted((*connections.names, *viewers.names))),
        )
        stack.callback(self._rig.close)
        self._rig.connect()
        server = RigServer(session, self.keys, served)
        stack.callback(server.close)
        server.open()

    def _begin_engine(self, session: zenoh.Session, owners: Presence) -> None:
        access: RigAccess
        if self._served is not None:
            access = LocalAccess(self._served)
        else:
            remote = RemoteRig(session, self.keys, resume_s=self._config.service.resume_s)
            access = RemoteAccess(remote, self._config.service.send, self._present)
        self._open.callback(access.close)
        streams = QueuedListener(self._streams(session, Role.ENGINE, ENGINE_STREAMS), "viewsep streams", self.crash)
        self._open.callback(streams.close)
        leftovers = Path(self._config.service.recordings)
        saving = threading.Thread(target=save_leftovers, args=(leftovers,), name="viewsep recovery")
        saving.start()
        self._open.callback(saving.join)
        self._engine = EngineRole(self._config, access, streams, owners.arrived, self._config_file)
        self._open.callback(self._engine.close)

    def _streams(self, session: zenoh.Session, role: Role, topics: tuple[str, ...]) -> Streams:
        streams = Streams(session, self.keys, topics)
        self._open.callback(streams.close)
        handler = LogStream(streams, role, whole_process=role is self.roles[0])
        log.addHandler(handler)
        self._open.callback(log.removeHandler, handler)
        return streams

    @property
    def _images(self) -> tuple[str, ...]:
        """Where this process's pictures are to be had; those of a router lead further than its own."""
        service = self._config.service
        return (*service.connect_images, *service.listen_images) if self._rig else ()

    def _answer(self, session: zenoh.Session) -> None:
        """Declare everything that can be asked for."""
        answers = {
            self.keys.status: lambda _: self.status().to_json(),
            self.keys.manifest: lambda _: manifest(self.keys, self._images),
        }
        for role in (self._rig, self._engine):
            if role is not None:
                answers |= {self.keys.command(name): answer for name, answer in role.answers().items()}
        answers[self.keys.command("stop")] = self._stop
        for key, answer in answers.items():
            self._open.callback(declare_answer(session, key, answer).undeclare)
        self._open.callback(declare_refusals(session, self.keys.command("*")).undeclare)

    def status(self) -> Status:
        """The sections of this process's roles."""
        return Status(
            name=self.keys.rig,
            alive=self._present(),
            build=self._build,
            unix_ns=time.time_ns(),
            rig=self._rig.status() if self._rig else None,
            engine=self._engine.status() if self._engine else None,
        )

    def _stop(self, payload: bytes) -> bytes:
        """Stop whatever moves and runs; the motors first. A request that cannot be read stops as well."""
        try:
            request = parse_request("stop", payload)
            unread: Refused | None = None
        except Refused as error:
            request, unread = StopRequest(owner="somebody unknown"), error
        assert isinstance(request, StopRequest)
        try:
            if self._rig is not None:
                self._rig.stop(request)
        finally:
            if self._engine is not None:
                self._engine.stop(request)
        return accepted("stop", roles=list(self.roles), **({"unread": str(unread)} if unread else {}))

    def _owner_gone(self, token: str) -> None:
        """A client that held a lease has gone."""
        if self._rig is not None:
            self._rig.owner_gone(token)
        if self._engine is not None:
            self._engine.owner_gone(token)

    def _role_gone(self, role: str) -> None:
        """The process of another role has gone."""
        if role not in self.roles:
            log.warning("the role %s of %s has gone", role, self.keys.rig)
            if self._rig is not None and role == Role.ENGINE:
                self._rig.engine_gone()
