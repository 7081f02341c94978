"""The engine: events in, commands out, nothing else (design section 1)."""

from __future__ import annotations

from dataclasses import replace

from viewsep.engine.keyframe import StateCodec
from viewsep.engine.state import EngineState, TaskLimits
from viewsep.engine.verdict import conclusion, failure, identification, indecision, pose_remark
from viewsep.geometry import angle_between
from viewsep.interfaces import Interpretation, Interpreter, NextView, Planner
from viewsep.messages import (
    CancelRequested,
    Command,
    DeadlinePassed,
    Event,
    FloatArray,
    FrameMissing,
    MoveFailed,
    MoveSettled,
    MoveTo,
    Percept,
    PerceptReceived,
    Phase,
    Result,
    RigFailed,
    Stop,
    TaskStarted,
)
from viewsep.planning.reachable import ReachableViews

BLIND = 3  # frames missing in a row: the rig waits before it moves on
Step = tuple[EngineState, tuple[Command, ...]]


class Engine:
    """`step(state, event) -> (state, commands)`. The same events give the same states, bit for bit."""

    def __init__(
        self,
        interpreter: Interpreter,
        planner: Planner,
        limits: TaskLimits | None = None,
        reachable: ReachableViews | None = None,
    ) -> None:
        self.interpreter = interpreter
        self.planner = planner
        self.limits = limits or TaskLimits()
        self.reachable = reachable
        self._codec = StateCodec(interpreter.state_type, planner.state_type)

    def start(self) -> EngineState:
        """Waiting for a task."""
        return EngineState()

    def save(self, state: EngineState) -> bytes:
        """`state` as bytes; equal states give equal bytes."""
        return self._codec.to_bytes(state)

    def restore(self, data: bytes) -> EngineState:
        """The state `data` was saved from. Raises BadInput when it is of another interpreter or planner."""
        return self._codec.from_bytes(data)

    def same(self, state: EngineState, data: bytes) -> bool:
        """Whether `data` was saved from the same state, as far as its version knew. Raises BadInput as `restore`."""
        return self._codec.same(state, data)

    def step(self, state: EngineState, event: Event) -> Step:
        """Take one event. Events after the result, or that belong to an abandoned move, change nothing."""
        if isinstance(event, TaskStarted):
            return self._begin(event)
        if state.phase in (Phase.IDLE, Phase.DONE):
            return state, ()
        match event:
            case PerceptReceived(percept):
                return self._see(state, percept)
            case MoveSettled(stamp_ns, command_id):
                if state.move is None or command_id != state.move.command_id:
                    return state, ()
                return self._arrive(state, stamp_ns)
            case MoveFailed():
                return self._retry(state, event)
            case FrameMissing():
                return self._miss(state, event)
            case DeadlinePassed(stamp_ns):
                return self._run_out(state, stamp_ns, "the time for the task is over")
            case CancelRequested(stamp_ns, reason):
                return self._end(state, failure(state, stamp_ns, f"cancelled: {reason}"))
            case RigFailed(stamp_ns, reason):
                return self._end(state, failure(state, stamp_ns, reason))
        raise TypeError(f"the engine does not know the event {event!r}")

    def _begin(self, event: TaskStarted) -> Step:
        planning, first = self.planner.start(event.seed, event.view_direction)
        state = EngineState(
            phase=Phase.STARTING,
            interpretation=self.interpreter.start(),
            planning=planning,
            view_direction=event.view_direction,
        )
        if first.view_direction is None:
            return self._go_on(replace(state, phase=Phase.EXPLORING), event.view_direction)
        return self._move(state, first)

    def _see(self, state: EngineState, percept: Percept) -> Step:
        """One iteration of the interpretation module, then the decision."""
        state = _noted(state, percept)
        if state.missing_frames:
            state = replace(state, missing_frames=0, missing_first=None)
        if percept.anew and state.looks:
            state = self._forget(state)
        elif self._repeats(state, percept):
            return state, ()
        if state.phase is Phase.STARTING:
            return state, ()
        interpretation, belief = self.interpreter.update(state.interpretation, percept)
        belief = self._with_sides(belief)
        assert state.view_direction is not None
        travelled = float(angle_between(state.view_direction, percept.view_direction)) if state.looks else 0.0
        state = replace(
            state,
            interpretation=interpretation,
            belief=belief,
            view_direction=percept.view_direction,
            looks=state.looks + 1,
            travel_rad=state.travel_rad + travelled,
            comparisons=state.comparisons + belief.estimate.comparisons,
            separating_view=None if belief.fresh else state.separating_view,
        )
        target = state.move_plan.target if state.move_plan else None
        state = replace(
            state,
            estimate=replace(
                belief.estimate,
                iteration=state.looks,
                phase=state.phase,
                travel_rad=state.travel_rad,
                target=target,
                note="; ".join([*state.notes[state.told :], *filter(None, [belief.estimate.note])]),
            ),
            told=len(state.notes),
        )
        if belief.conclusion and self._pose_known(belief) and len(belief.unseen) == 0:
            return self._end(state, conclusion(state, percept.stamp_ns, belief.conclusion))
        if belief.conclusion is None and self._judges(state, percept.view_direction):
            state = replace(state, leads=_leads(state, belief.leader))
            if belief.leader >= 0 and state.leads[1] >= self.limits.confirming_looks:
                return self._end(state, identification(state, belief))
        if state.looks >= self.limits.max_looks:
            reason = f"no candidate stood out within {self.limits.max_looks} looks"
            return self._run_out(state, percept.stamp_ns, reason)
        if state.dwelling:
            return self._go_on(replace(state, dwelling=False), state.view_direction)
        return state, ()

    def _forget(self, state: EngineState) -> EngineState:
        """Perhaps another object is shown now: all that was believed is open again, and the budget goes on."""
        began = self.interpreter.start()
        return replace(state, interpretation=began, belief=None, separating_view=None, leads=(-1, 0))

    def _with_sides(self, belief: Interpretation) -> Interpretation:
        """With what is yet to be seen before a name is given: what was not learned may differ there."""
        if self.reachable is None or self.limits.look_around <= 0.0 or belief.conclusion is None or belief.leader < 0:
            return belief
        unseen = self.reachable.unseen(belief.samples.seen)
        enough = len(unseen) <= (1.0 - self.limits.look_around) * len(self.reachable.directions)
        return belief if enough else replace(belief, unseen=unseen)

    def _pose_known(self, belief: Interpretation) -> bool:
        """Whether the pose of what is concluded is good enough to end; there is none of an unknown object."""
        if belief.leader < 0:
            return True
        return belief.estimate.candidates[belief.leader].variance <= self.limits.pose_tolerance_rad**2

    def _run_out(self, state: EngineState, stamp_ns: int, reason: str) -> Step:
        """The budget is spent: a name that only waited for its pose is said all the same."""
        if state.belief and state.belief.conclusion:
            what = "enough of it was seen" if self._pose_known(state.belief) else "its pose was sure"
            known = pose_remark(state.belief, f"the budget was spent before {what}")
            return self._end(state, conclusion(state, stamp_ns, known))
        return self._end(state, indecision(state, stamp_ns, reason))

    def _repeats(self, state: EngineState, percept: Percept) -> bool:
        """Whether a percept shows what the last one showed and nothing waits for it."""
        assert state.view_direction is not None
        turned = angle_between(state.view_direction, percept.view_direction)
        return state.looks > 0 and not state.dwelling and bool(turned < self.limits.look_every_rad)

    def _judges(self, state: EngineState, view: FloatArray) -> bool:
        """Whether `view` is one at which the rating decides."""
        if state.separating_view is None:
            return False
        return bool(angle_between(state.separating_view, view) <= self.limits.judge_within_rad)

    def _arrive(self, state: EngineState, stamp_ns: int) -> Step:
        """The move has settled: judge at a separating view, otherwise go on."""
        assert state.move is not None
        assert state.move_plan is not None
        here = state.move.view_direction
        arrives = state.move_plan.arrives
        state = replace(state, failed_moves=0)
        if state.phase is Phase.STARTING:
            return self._go_on(replace(state, phase=Phase.EXPLORING), here)
        if arrives and not (state.belief and state.belief.fresh):  # wait for a percept from here before going on
            return replace(state, phase=Phase.JUDGING, separating_view=here, dwelling=True, move=None), ()
        return self._go_on(state, here)

    def _go_on(self, state: EngineState, here: FloatArray | None) -> Step:
        """Ask the planner for the next view and drive there; stay and look again where it has none."""
        assert here is not None
        if state.missing_frames >= BLIND:
            return replace(state, move=None, dwelling=True), ()
        planning, plan = self.planner.next_view(state.planning, here, state.belief)
        state = replace(state, planning=planning)
        if plan.conclusion and state.belief:
            named = pose_remark(state.belief, plan.conclusion.reason) if state.belief.conclusion else plan.conclusion
            return self._end(state, conclusion(state, state.belief.estimate.stamp_ns, named))
        if plan.view_direction is None:
            return replace(state, move=None, move_plan=plan, dwelling=True), ()
        return self._move(replace(state, phase=plan.purpose), plan)

    def _move(self, state: EngineState, plan: NextView) -> Step:
        assert plan.view_direction is not None
        move = MoveTo(state.commands, plan.view_direction, plan.purpose)
        return replace(state, move=move, move_plan=plan, commands=state.commands + 1), (move,)

    def _retry(self, state: EngineState, event: MoveFailed) -> Step:
        """Try the move again; give up after several failures in a row."""
        if state.move is None or event.command_id != state.move.command_id:
            return state, ()
        failed = state.failed_moves + 1
        if failed >= self.limits.max_failed_moves:
            return self._end(state, failure(state, event.stamp_ns, f"{failed} moves failed in a row: {event.reason}"))
        assert state.move_plan is not None
        return self._move(replace(state, failed_moves=failed), state.move_plan)

    def _miss(self, state: EngineState, event: FrameMissing) -> Step:
        missing = state.missing_frames + 1
        state = replace(state, missing_frames=missing, missing_first=state.missing_first or event)
        if missing >= self.limits.max_missing_frames:
            return self._end(state, failure(state, event.stamp_ns, _missed(state, event.stamp_ns, event.reason)))
        return state, ()

    def _end(self, state: EngineState, result: Result) -> Step:
        """Publish the result and hold still."""
        result = replace(result, reason="; ".join([result.reason, *state.notes]))
        estimate = replace(state.estimate, phase=Phase.DONE) if state.estimate else None
        state = replace(state, phase=Phase.DONE, result=result, estimate=estimate, commands=state.commands + 1)
        return state, (Stop(state.commands - 1, result.outcome.value),)


def _missed(state: EngineState, stamp_ns: int, reason: str) -> str:
    """How many frames are missing until now, for how long and why."""
    assert state.missing_first is not None
    seconds = (stamp_ns - state.missing_first.stamp_ns) * 1e-9
    lasted = f", for {seconds:.1f} s" if seconds > 0 else ""
    return f"{state.missing_frames} frames missing in a row{lasted}: {reason}"


def _noted(state: EngineState, percept: Percept) -> EngineState:
    """With what perception says of a percept and was not said before in this task."""
    anew = (f"{percept.anew}: what was seen before does not count",) if percept.anew and state.looks else ()
    first = state.missing_first
    if first and state.missing_frames >= BLIND and not anew:
        anew = (_missed(state, percept.stamp_ns, first.reason),)
    new = [note for note in (*anew, *percept.notes) if note not in state.notes]
    return replace(state, notes=(*state.notes, *new)) if new else state


def _leads(state: EngineState, leader: int) -> tuple[int, int]:
    """Who leads now, and at how many judged looks in a row."""
    led_before, looks = state.leads
    return leader, looks + 1 if leader == led_before else 1
