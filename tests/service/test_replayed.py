"""A recording played onto Zenoh: clients see a rig, get its very bytes in order, and cannot move it."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from pathlib import Path

import pytest
from fake_service import fake_service
from ports import free_port
from processes import running, until
from rich.console import Console
from zenoh.handlers import FifoChannel

from viewsep.cli import replay_live
from viewsep.client import Client, LogLine, NoAnswer, Received, RequestRefused, Stream, rigs
from viewsep.config import ServiceConfig
from viewsep.errors import BadConfig, BadInput
from viewsep.recordings.codec import IMAGE_TOPIC, to_bytes
from viewsep.recordings.pacing import Playback
from viewsep.recordings.reader import Recorded, Recording, read_recording
from viewsep.service.link import RigLink
from viewsep.service.names import PUBLISHED, Keys
from viewsep.service.replayed import ReplayedRig
from viewsep.service.requests import REQUESTS, Refused
from viewsep.service.transport import client_session

GOLDEN = Path(__file__).parents[1] / "golden" / "v1.mcap"
BLOCKING = ("percept", "event", "command", "estimate", "result")


@pytest.fixture(scope="module")
def golden() -> Recording:
    return read_recording(GOLDEN)


def served(name: str = "played", port: int = 0, connect: tuple[str, ...] = ()) -> ServiceConfig:
    listen = f"tcp/127.0.0.1:{port or free_port()}"
    return ServiceConfig(name=name, listen=(listen,), listen_images=(f"tcp/127.0.0.1:{free_port()}",), connect=connect)


@contextmanager
def replayed(
    content: Recording, pace: float, service: ServiceConfig | None = None
) -> Iterator[tuple[ReplayedRig, Client]]:
    """The recording as a rig, and a client of it."""
    service = service or served()
    with (
        ReplayedRig(service, content, GOLDEN, Playback(content, pace)) as rig,
        Client(service.name, connect=service.listen, owner="ana", timeout_s=10.0) as client,
    ):
        yield rig, client


def heard(stream: Stream, counts: Mapping[str, int]) -> dict[str, list[Received]]:
    """What comes until there are so many on each topic, and what is there then."""
    by_topic: dict[str, list[Received]] = defaultdict(list)
    while any(len(by_topic[topic]) < count for topic, count in counts.items()):
        received = stream.receive(10.0)
        assert received is not None, {topic: len(those) for topic, those in by_topic.items()}
        by_topic[received.topic].append(received)
    while (received := stream.receive(0.0)) is not None:
        by_topic[received.topic].append(received)
    return by_topic


def test_a_client_gets_the_very_bytes_in_order_and_complete(golden: Recording) -> None:
    recorded: dict[str, list[Recorded]] = defaultdict(list)
    for message in golden.messages:
        recorded[message.topic].append(message)
    with replayed(golden, 0.0) as (rig, client), client.images() as pictures, client.watch() as stream:
        until(lambda: rig.watched() >= set(PUBLISHED), 10, "nobody subscribes")
        seen = []
        for _ in rig.play():
            if (picture := pictures.receive(0.0)) is not None:
                seen.append(picture)
        by_topic = heard(stream, {topic: len(recorded[topic]) for topic in BLOCKING})
        while (picture := pictures.receive(0.0)) is not None:
            seen.append(picture)
        assert stream.unreadable == pictures.unreadable == 0
        engine = client.status().engine
    for topic in BLOCKING:
        assert [r.sequence for r in by_topic[topic]] == list(range(len(recorded[topic])))
    for received in chain(*(by_topic[topic] for topic in (*BLOCKING, "motion/state"))):  # the latter may be dropped
        original = recorded[received.topic][received.sequence]
        assert not isinstance(received.message, LogLine)
        assert (received.stamp_ns, to_bytes(received.message)) == (original.stamp_ns, original.raw)
    assert seen
    for picture in seen:
        original_frame = golden.frames[picture.sequence]
        assert (picture.stamp_ns, picture.jpeg) == (original_frame.stamp_ns, original_frame.jpeg)
    assert engine is not None
    assert engine.result is not None
    assert (engine.result.task, engine.result.object) == ("v1", "product_7_twin_face")


def test_at_its_own_pace_every_picture_comes_and_the_status_follows(golden: Recording) -> None:
    service = served()
    with replayed(golden, 12.0, service) as (rig, client):
        session = client_session(service.listen_images, None, "", 10.0)
        pictures = session.declare_subscriber(Keys(service.name).image, FifoChannel(1000))
        waiting = client.status()
        assert waiting.engine is not None
        assert (waiting.engine.task, waiting.engine.phase) == ("v1", "idle")
        until(lambda: IMAGE_TOPIC in rig.watched(), 10, "nobody subscribes")
        begun_s = time.monotonic()
        middle = None
        for item in rig.play():
            if middle is None and item.stamp_ns > 9_000_000_000:
                middle = client.status()
        assert 17.6 / 12 <= time.monotonic() - begun_s < 17.6
        payloads: list[bytes] = []
        while len(payloads) < len(golden.frames):
            sample = until(pictures.try_recv, 10, f"{len(payloads)} pictures came")
            assert sample is not None
            payloads.append(sample.payload.to_bytes())
        pictures.undeclare()
        session.close()
    assert all(frame.jpeg in payload for frame, payload in zip(golden.frames, payloads, strict=True))
    assert middle is not None
    assert middle.alive == ("engine", "rig")
    assert middle.replay is not None
    assert (middle.replay.file, middle.replay.pace) == (str(GOLDEN), 12.0)
    assert middle.replay.duration_s == pytest.approx(17.6)
    assert 9.0 <= middle.replay.position_s < 17.6
    assert middle.rig is not None
    assert middle.rig.motion.joints[1].name == "pan"
    assert middle.rig.camera.rate_hz == pytest.approx(3.75, abs=0.5)
    assert middle.rig.clock_ns == pytest.approx(middle.replay.position_s * 1e9)
    assert middle.engine is not None
    assert middle.engine.looks > 0
    assert middle.engine.owner == "replay"


def test_every_request_is_refused(golden: Recording) -> None:
    service = served()
    with replayed(golden, 0.0, service) as (_, client):
        for command in REQUESTS:
            with pytest.raises(RequestRefused, match=rf"'played' is a replay of {re.escape(str(GOLDEN))}: ") as refusal:
                client.request(command)
            assert (refusal.value.code, refusal.value.exit_code) == ("replay", 1)
        with pytest.raises(RequestRefused, match="nothing to move"):
            client.stop("smoke")
        with pytest.raises(RequestRefused) as unknown:
            client.request("dance")
        assert unknown.value.code == "unknown_command"
        session = client_session(service.listen, None, "", 10.0)
        with pytest.raises(Refused, match="is a replay of"):
            RigLink(session, Keys("played")).ask("acquire", holder="an engine elsewhere")
        session.close()
        assert client.manifest()["images"] == list(service.listen_images)
        assert [(rig.name, rig.roles) for rig in rigs(service.listen)] == [("played", ("engine", "rig"))]


def test_a_name_that_is_taken_is_refused(golden: Recording) -> None:
    with fake_service("bench") as live:
        with (
            pytest.raises(BadInput, match=rf"rig 'bench' is already served at {live.endpoint} \(engine, rig\): end it"),
            replayed(golden, 0.0, served("bench", live.port)),
        ):
            pass
        elsewhere = served("bench", connect=(live.endpoint,))
        with pytest.raises(BadInput, match=r"already served .* under another --name"), replayed(golden, 0.0, elsewhere):
            pass
        with pytest.raises(BadInput, match="cannot listen"), replayed(golden, 0.0, served("other", live.port)):
            pass
        port = int(elsewhere.listen[0].rpartition(":")[2])
        with replayed(golden, 0.0, served("other", port, (live.endpoint,))) as (_, client):  # nothing was left open
            assert client.status().name == "other"


def test_without_keys_nobody_on_the_network_sees_it(golden: Recording) -> None:
    with pytest.raises(BadConfig, match="without keys"):
        ReplayedRig(ServiceConfig(listen=("tcp/0.0.0.0:7447",)), golden, GOLDEN, Playback(golden)).__enter__()


def test_viewers_are_waited_for(golden: Recording) -> None:
    with replayed(golden, 0.0) as (rig, client):
        assert not rig.wait_for_viewers(0.05)
        assert not rig.wait_for_viewers(60.0, lambda _: True)
        with client.watch(("result",)):
            assert rig.wait_for_viewers(10.0)


PLAYS = """
import sys
from pathlib import Path
from viewsep.cli.replay_live import play
from viewsep.recordings.reader import read_recording
file, config = Path(sys.argv[1]), Path(sys.argv[2])
played = play(read_recording(file), file, 20.0, publish=True, config=config, loop=True, viewers_s=20.0)
print(played.passes, played.interrupted, flush=True)
sys.exit(played.exit_code)
"""


def test_it_goes_on_until_ctrl_c_and_watching_it_ends_with_its_result(tmp_path: Path) -> None:
    service = served()
    with running(PLAYS, str(GOLDEN), str(_config(tmp_path, service))) as process:
        until(lambda: _seen(service), 20, "it is not there")
        with Client(connect=service.listen, timeout_s=10.0) as client, client.watch() as stream:
            assert client.rig == "bench"  # as it was recorded
            lines: list[Received] = []
            result = client.wait("v1", timeout_s=20, heard=lines.append, stream=stream)
            assert (result.outcome, result.object) == ("identified", "product_7_twin_face")
            assert [line.topic for line in lines].count("estimate") == 33
            said = [line.message.message for line in lines if isinstance(line.message, LogLine)]
            assert f"{GOLDEN} is played as v1" in said
            until(
                lambda: (engine := client.status().engine) and engine.task == "v1-2" and engine.looks, 10, "not again"
            )
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=20)
    assert process.returncode == 130
    assert out.splitlines()[0].startswith("It is product_7_twin_face")
    assert out.splitlines()[-1] == "1 True"


def test_ctrl_c_ends_the_wait_for_viewers(golden: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("viewsep.cli.serve.show_log", lambda: None)
    service = served()

    def interrupt_it() -> None:
        until(lambda: _seen(service), 20, "it is not there")
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt_it)
    thread.start()
    played = replay_live.play(golden, GOLDEN, publish=True, config=_config(tmp_path, service), viewers_s=60.0)
    thread.join()
    assert played == replay_live.Played(0, 0, 0, True)
    assert played.exit_code == 130


def _config(folder: Path, service: ServiceConfig) -> Path:
    """A configuration file that says where it is served, and nothing else."""
    path = folder / "rig.toml"
    table = {"listen": list(service.listen), "listen_images": list(service.listen_images)}
    path.write_text("[service]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in table.items()))
    return path


def _seen(service: ServiceConfig) -> bool:
    try:
        return bool(rigs(service.listen, timeout_s=0.1))
    except NoAnswer:
        return False


def test_in_the_terminal_it_shows_how_far_it_is(golden: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    screen, out = Console(file=io.StringIO(), force_terminal=True, width=120), Console(file=io.StringIO(), width=200)
    monkeypatch.setattr(replay_live, "people", screen)
    played = replay_live.play(golden, GOLDEN, 0.0, say=out)
    assert played == replay_live.Played(1, 1240, 66, False)
    assert played.exit_code == 0
    assert isinstance(screen.file, io.StringIO)
    assert isinstance(out.file, io.StringIO)
    for words in ("as fast as possible", "17.6 of 17.6 s", "done", "look 33", "product_7_twin_face", "spread deg"):
        assert words in screen.file.getvalue()
    assert out.file.getvalue().startswith("It is product_7_twin_face: ")


def test_options_that_do_not_go_together_are_refused(golden: Recording) -> None:
    with pytest.raises(BadInput, match="go with --publish"):
        replay_live.play(golden, GOLDEN, name="bench")
    with pytest.raises(BadConfig, match=r"service\.name.*'a/b'"):
        replay_live.play(golden, GOLDEN, publish=True, name="a/b")
