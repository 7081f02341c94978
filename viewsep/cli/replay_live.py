"""Playing a recording as if it were live, in the terminal and, if asked for, on Zenoh."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from viewsep.account import Account
from viewsep.cli.console import people, results
from viewsep.cli.exit_codes import EXIT_INTERRUPTED
from viewsep.cli.status_tables import candidate_table
from viewsep.config import Config, ServiceConfig, load_config, parse_config
from viewsep.errors import BadInput
from viewsep.messages import Result
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.pacing import Item, Playback
from viewsep.recordings.reader import Recording
from viewsep.service.board import Board, candidate_status
from viewsep.service.ending import Ending

if TYPE_CHECKING:  # Zenoh is slow to import
    from viewsep.service.replayed import ReplayedRig

BAR_WIDTH = 40


@dataclass(frozen=True, slots=True)
class Played:
    """How often it was played to the end, how many messages and pictures that were, and whether somebody stopped it."""

    passes: int
    messages: int
    pictures: int
    interrupted: bool

    @property
    def exit_code(self) -> int:
        """0 at the end, 130 when it was interrupted."""
        return EXIT_INTERRUPTED if self.interrupted else 0


def play(
    recording: Recording,
    file: Path,
    pace: float = 1.0,
    *,
    publish: bool = False,
    name: str | None = None,
    config: Path | None = None,
    loop: bool = False,
    viewers_s: float = 0.0,
    say: Console = results,
) -> Played:
    """Play what was read from `file` to its end or, with `loop`, until Ctrl-C or SIGTERM. For the main thread.

    On terminals a table shows how far it is and what the engine believed; how the task ended goes to `say`. With
    `publish` it is seen on Zenoh as a rig called `name` (else as the configuration file or the recording says), served
    as the file `config` says; it waits up to `viewers_s` for the first viewer. Raises BadInput for options that do not
    go together, for a rig of that name that is there already, and for a recording that holds nothing.
    """
    if not publish and (name or config or viewers_s):
        raise BadInput("--name, --config and a wait for viewers go with --publish: add it, or leave them out")
    stop = _Stop()
    playback = Playback(recording, pace, wait=stop.wait)
    shown = Screen(file, playback)
    passes = 0
    with ExitStack() as stack:
        stack.enter_context(stop.ending.while_on_signals())
        rig = _published(recording, file, playback, _served_as(recording, name, config), stack) if publish else None
        stack.enter_context(shown)
        if rig is not None and viewers_s:
            rig.wait_for_viewers(viewers_s, stop.wait)
        while not stop.asked and (loop or passes == 0):
            for item in rig.play() if rig is not None else playback:
                shown.hear(item)
            passes += not stop.asked
        interrupted = stop.asked
        if rig is not None:
            rig.linger(stop.wait)
    if shown.result is not None:
        say.print(Text(Account.of(shown.result).sentence), soft_wrap=True)
    return Played(passes, shown.messages, shown.pictures, interrupted)


class _Stop:
    """Whether Ctrl-C or SIGTERM has come, asked as often as one likes."""

    def __init__(self) -> None:
        self.ending = Ending()
        self.asked = False

    def wait(self, timeout_s: float) -> bool:
        """Sleep for so long; True, at once, when it has come."""
        self.asked = self.asked or self.ending.wait(timeout_s)
        return self.asked


class Screen:
    """What is played: counted, and drawn on terminals. `result` is the last one that was heard, None without."""

    def __init__(self, file: Path, playback: Playback) -> None:
        self.messages = self.pictures = 0
        self.result: Result | None = None
        self._file = file
        self._playback = playback
        self._board = Board()
        self._live = Live(console=people, get_renderable=self._drawn, refresh_per_second=8, transient=True)

    def __enter__(self) -> Screen:
        pace = f"at pace {self._playback.pace:g}" if self._playback.pace else "as fast as possible"
        people.print(
            f"playing {self._file}, {self._playback.duration_s:.1f} s, {pace}",
            soft_wrap=True,
            markup=False,
            highlight=False,
        )
        if people.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def hear(self, item: Item) -> None:
        """Something was played."""
        if isinstance(item, RecordedFrame):
            self.pictures += 1
            return
        self.messages += 1
        self._board.hear(item.stamp_ns, item.message)
        if isinstance(item.message, Result):
            self.result = item.message

    def _drawn(self) -> RenderableType:
        """Called from Live's own thread."""
        phase, estimate = self._board.read()
        position_s, duration_s = self._playback.position_s, self._playback.duration_s
        line = Table.grid(padding=(0, 2))
        line.add_row(
            Text(self._file.name),
            ProgressBar(total=duration_s or 1.0, completed=position_s, width=BAR_WIDTH),
            f"{position_s:.1f} of {duration_s:.1f} s",
            phase.value,
            f"look {estimate.iteration}" if estimate else "",
        )
        if estimate is None or not estimate.candidates:
            return line
        return Group(line, candidate_table(tuple(map(candidate_status, estimate.candidates)), estimate.unknown))


def _published(
    recording: Recording, file: Path, playback: Playback, service: ServiceConfig, stack: ExitStack
) -> ReplayedRig:
    """The recording on Zenoh until the stack ends."""
    from viewsep.cli.serve import show_log
    from viewsep.service.replayed import ReplayedRig

    show_log()
    rig = stack.enter_context(ReplayedRig(service, recording, file, playback))
    people.print(
        f"published as rig {service.name} on {' '.join(service.listen)}", soft_wrap=True, markup=False, highlight=False
    )
    return rig


def _served_as(recording: Recording, name: str | None, file: Path | None) -> ServiceConfig:
    """How it is served: as a configuration file says, under the name given, that of the file, or the recorded one."""
    from viewsep.service.shown import recorded_config

    service = load_config(file).service if file else Config().service
    recorded = recorded_config(recording)
    if name is None and recorded is not None and "name" not in service.model_fields_set:
        name = recorded.service.name
    if name is None:
        return service
    table = service.model_dump(exclude_unset=True) | {"name": name}
    return parse_config({"service": table}, "the command line").service
