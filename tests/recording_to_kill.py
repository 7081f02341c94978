"""Records the golden task again and again, each time in a child that somebody kills.

For every line on stdin (`PATH ROTATE_MB`) a child is forked that records to PATH; its process id is printed, then after
every message heard the number of messages so far and the time on the monotonic clock.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from viewsep.assembly import make_engine
from viewsep.config import RecordingConfig
from viewsep.messages import Keyframe, Message, PerceptReceived
from viewsep.recording import task_recorder
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import Replaying, restore

GOLDEN = Path(__file__).parent / "golden" / "v1.mcap"
SYNC_S = 0.05
EVENTS_PER_KEYFRAME = 10


def heard() -> Iterator[tuple[int, Message]]:
    """What a recorder hears in the golden task, with a keyframe after every tenth event."""
    recording = read_recording(GOLDEN)
    frames = {frame.stamp_ns: frame.decode() for frame in recording.frames}
    replaying = Replaying(make_engine(*restore(recording)))
    events = 0
    for recorded in recording.messages:
        message, stamp_ns = recorded.message, recorded.stamp_ns
        is_event = recorded.topic in ("event", "percept")
        if is_event and replaying.state is not None and events % EVENTS_PER_KEYFRAME == 1:
            yield stamp_ns, Keyframe(stamp_ns, replaying.engine.save(replaying.state))
        if isinstance(message, PerceptReceived):
            yield stamp_ns, frames[message.stamp_ns]
        events += is_event
        replaying.take(message)
        yield stamp_ns, message


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def record(path: Path, rotate_mb: float, messages: list[tuple[int, Message]]) -> None:
    config, models = restore(read_recording(GOLDEN))
    config = config.model_copy(update={"recording": RecordingConfig(sync_s=SYNC_S, rotate_mb=rotate_mb)})
    with task_recorder(path, config, models, seed=1, truth="") as recorder:
        for number, (stamp_ns, message) in enumerate(messages, 1):
            recorder.hear(stamp_ns, message)
            say(f"{number} {time.monotonic()}")
            time.sleep(0.001)
        time.sleep(60.0)  # somebody kills it


def main() -> None:
    messages = list(heard())
    say("ready")
    for line in sys.stdin:
        path, rotate_mb = line.split()
        child = os.fork()
        if child == 0:
            record(Path(path), float(rotate_mb), messages)
            os._exit(0)
        say(f"child {child}")
        os.waitpid(child, 0)
        say("ended")


if __name__ == "__main__":
    main()
