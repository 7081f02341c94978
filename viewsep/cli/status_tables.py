"""The status as tables."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType
from rich.table import Column, Table
from rich.text import Text

from viewsep.account import NONE_OF_THEM, percent
from viewsep.service.status import CandidateStatus, EngineStatus, ReplayStatus, RigStatus, Status


def tables(status: Status) -> Iterator[RenderableType]:
    """Everything that is known, in the order it matters; a role that did not answer is said to be silent."""
    yield _overview(status)
    if status.rig and status.rig.motion.joints:
        yield _joints(status.rig)
    if status.engine and status.engine.candidates:
        yield candidate_table(status.engine.candidates, status.engine.unknown)


def _overview(status: Status) -> Table:
    table = Table("", "state", title=f"{status.name} (viewsep {status.build.get('viewsep', 'of an unknown version')})")
    for name, said in (*_replay_rows(status.replay), *_rig_rows(status.rig), *_engine_rows(status.engine)):
        table.add_row(name, Text(said))  # as text: others wrote it, and it may look like markup
    return table


def _replay_rows(replay: ReplayStatus | None) -> Iterator[tuple[str, str]]:
    if replay is not None:
        pace = f"at pace {replay.pace:g}" if replay.pace else "as fast as possible"
        yield "replay", f"of {replay.file}, {pace}: {replay.position_s:.1f} of {replay.duration_s:.1f} s; nothing moves"


def _rig_rows(rig: RigStatus | None) -> Iterator[tuple[str, str]]:
    if rig is None:
        yield "rig", "no answer"
        return
    kind = "simulated" if rig.simulated else "real"
    yield "rig", f"{kind}{f', holds {rig.holds}' if rig.holds else ''}, up {rig.uptime_s:.0f} s"
    motion, camera = rig.motion, rig.camera
    state = "not connected" if not motion.connected else "moving" if motion.moving else "standing"
    yield "motion", f"{state}{f', in the hands of {motion.holder}' if motion.holder else ''}"
    if motion.counters:
        yield "bus", ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in motion.counters.items())
    age = "" if camera.newest_age_s is None else f", newest {camera.newest_age_s:.2f} s old"
    yield (
        "camera",
        f"{camera.rate_hz:.1f} Hz{age}, {camera.drops} dropped" if camera.connected else "not connected",
    )
    if rig.connections:
        yield "connections", ", ".join(rig.connections)
    for fault in (*((motion.fault,) if motion.fault else ()), *rig.faults):
        yield "fault", fault


def _engine_rows(engine: EngineStatus | None) -> Iterator[tuple[str, str]]:
    if engine is None:
        yield "engine", "no answer"
        return
    link = "in one process with the rig" if engine.link.local else "up" if engine.link.up else "down"
    yield "engine", f"{engine.phase}, up {engine.uptime_s:.0f} s, link to the rig {link}"
    if engine.task:
        yield "task", f"{engine.task} of {engine.owner}: {engine.looks} looks, {engine.travel_deg:.0f}° of travel"
    if engine.result:
        account = engine.result.account
        pose = f" {account.pose.capitalize()}." if account.pose else ""
        yield "last result", f"{engine.result.task}: {account.sentence}{pose}"
    yield "models", ", ".join(engine.models) or "none"
    if engine.learning:
        yield "learning", engine.learning
    recording = engine.recording
    file = f", {recording.file} ({recording.bytes:,} bytes{', open' if recording.open else ''})"
    lost = f", {recording.lost} messages lost" if recording.lost else ""
    yield "recording", f"{'on' if recording.enabled else 'off'}{file if recording.file else ''}{lost}"
    for fault in engine.faults:
        yield "fault", fault


def _joints(rig: RigStatus) -> Table:
    table = Table("joint", "position deg", "set-point deg", "temperature °C")
    for joint in rig.motion.joints:
        temperature = "" if joint.temperature_c is None else f"{joint.temperature_c:.0f}"
        table.add_row(Text(joint.name), f"{joint.position_deg:.2f}", f"{joint.setpoint_deg:.2f}", temperature)
    return table


def candidate_table(
    candidates: tuple[CandidateStatus, ...], unknown: float | None = None, title: str = "", truth: str = ""
) -> Table:
    """Candidates, the best one first, and none of them where that has a probability. `truth` is marked.

    Probabilities take the place of ratings: they say the same better, and terminals are narrow.
    """
    rated = any(candidate.probability is not None for candidate in candidates)
    table = Table(Column("candidate", no_wrap=True), title=title or None)
    table.add_column("probability" if rated else "rating", no_wrap=rated)
    for column in ("w0", "w1 deg", "w2", "pose x y z w", "spread deg"):
        table.add_column(column)
    for candidate in sorted(candidates, key=lambda candidate: candidate.rating):
        spread = "" if candidate.spread_deg is None else f"{candidate.spread_deg:.1f}"
        table.add_row(
            Text(candidate.name + (" (truth)" if candidate.name == truth else "")),
            _percent(candidate.probability) if rated else f"{candidate.rating:.1f}",
            f"{candidate.w0:.3f}",
            f"{candidate.w1_deg:.1f}",
            f"{candidate.w2:.3f}",
            " ".join(f"{x:+.2f}" for x in candidate.pose_quaternion_xyzw),
            spread + (" settled" if candidate.converged else ""),
        )
    if rated and unknown is not None:
        table.add_row(NONE_OF_THEM, _percent(unknown))
    return table


def _percent(probability: float | None) -> str:
    return "" if probability is None else percent(probability)
