from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class JointState(_message.Message):
    __slots__ = ("stamp_ns", "position_rad", "setpoint_rad", "moving", "fault")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    POSITION_RAD_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_RAD_FIELD_NUMBER: _ClassVar[int]
    MOVING_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    position_rad: _containers.RepeatedScalarFieldContainer[float]
    setpoint_rad: _containers.RepeatedScalarFieldContainer[float]
    moving: bool
    fault: str
    def __init__(self, stamp_ns: _Optional[int] = ..., position_rad: _Optional[_Iterable[float]] = ..., setpoint_rad: _Optional[_Iterable[float]] = ..., moving: _Optional[bool] = ..., fault: _Optional[str] = ...) -> None: ...

class Percept(_message.Message):
    __slots__ = ("stamp_ns", "sequence", "descriptor", "feature", "view_direction", "notes", "anew")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTOR_FIELD_NUMBER: _ClassVar[int]
    FEATURE_FIELD_NUMBER: _ClassVar[int]
    VIEW_DIRECTION_FIELD_NUMBER: _ClassVar[int]
    NOTES_FIELD_NUMBER: _ClassVar[int]
    ANEW_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    sequence: int
    descriptor: str
    feature: _containers.RepeatedScalarFieldContainer[float]
    view_direction: _containers.RepeatedScalarFieldContainer[float]
    notes: _containers.RepeatedScalarFieldContainer[str]
    anew: str
    def __init__(self, stamp_ns: _Optional[int] = ..., sequence: _Optional[int] = ..., descriptor: _Optional[str] = ..., feature: _Optional[_Iterable[float]] = ..., view_direction: _Optional[_Iterable[float]] = ..., notes: _Optional[_Iterable[str]] = ..., anew: _Optional[str] = ...) -> None: ...

class Event(_message.Message):
    __slots__ = ("task_started", "move_settled", "move_failed", "frame_missing", "deadline_passed", "cancel_requested", "rig_failed")
    TASK_STARTED_FIELD_NUMBER: _ClassVar[int]
    MOVE_SETTLED_FIELD_NUMBER: _ClassVar[int]
    MOVE_FAILED_FIELD_NUMBER: _ClassVar[int]
    FRAME_MISSING_FIELD_NUMBER: _ClassVar[int]
    DEADLINE_PASSED_FIELD_NUMBER: _ClassVar[int]
    CANCEL_REQUESTED_FIELD_NUMBER: _ClassVar[int]
    RIG_FAILED_FIELD_NUMBER: _ClassVar[int]
    task_started: TaskStarted
    move_settled: MoveSettled
    move_failed: MoveFailed
    frame_missing: FrameMissing
    deadline_passed: DeadlinePassed
    cancel_requested: CancelRequested
    rig_failed: RigFailed
    def __init__(self, task_started: _Optional[_Union[TaskStarted, _Mapping]] = ..., move_settled: _Optional[_Union[MoveSettled, _Mapping]] = ..., move_failed: _Optional[_Union[MoveFailed, _Mapping]] = ..., frame_missing: _Optional[_Union[FrameMissing, _Mapping]] = ..., deadline_passed: _Optional[_Union[DeadlinePassed, _Mapping]] = ..., cancel_requested: _Optional[_Union[CancelRequested, _Mapping]] = ..., rig_failed: _Optional[_Union[RigFailed, _Mapping]] = ...) -> None: ...

class TaskStarted(_message.Message):
    __slots__ = ("stamp_ns", "seed", "view_direction")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    VIEW_DIRECTION_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    seed: int
    view_direction: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, stamp_ns: _Optional[int] = ..., seed: _Optional[int] = ..., view_direction: _Optional[_Iterable[float]] = ...) -> None: ...

class MoveSettled(_message.Message):
    __slots__ = ("stamp_ns", "command_id")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    COMMAND_ID_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    command_id: int
    def __init__(self, stamp_ns: _Optional[int] = ..., command_id: _Optional[int] = ...) -> None: ...

class MoveFailed(_message.Message):
    __slots__ = ("stamp_ns", "command_id", "reason")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    COMMAND_ID_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    command_id: int
    reason: str
    def __init__(self, stamp_ns: _Optional[int] = ..., command_id: _Optional[int] = ..., reason: _Optional[str] = ...) -> None: ...

class FrameMissing(_message.Message):
    __slots__ = ("stamp_ns", "reason")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    reason: str
    def __init__(self, stamp_ns: _Optional[int] = ..., reason: _Optional[str] = ...) -> None: ...

class DeadlinePassed(_message.Message):
    __slots__ = ("stamp_ns",)
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    def __init__(self, stamp_ns: _Optional[int] = ...) -> None: ...

class CancelRequested(_message.Message):
    __slots__ = ("stamp_ns", "reason")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    reason: str
    def __init__(self, stamp_ns: _Optional[int] = ..., reason: _Optional[str] = ...) -> None: ...

class RigFailed(_message.Message):
    __slots__ = ("stamp_ns", "reason")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    reason: str
    def __init__(self, stamp_ns: _Optional[int] = ..., reason: _Optional[str] = ...) -> None: ...

class Command(_message.Message):
    __slots__ = ("move_to", "stop")
    MOVE_TO_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    move_to: MoveTo
    stop: Stop
    def __init__(self, move_to: _Optional[_Union[MoveTo, _Mapping]] = ..., stop: _Optional[_Union[Stop, _Mapping]] = ...) -> None: ...

class MoveTo(_message.Message):
    __slots__ = ("command_id", "view_direction", "purpose")
    COMMAND_ID_FIELD_NUMBER: _ClassVar[int]
    VIEW_DIRECTION_FIELD_NUMBER: _ClassVar[int]
    PURPOSE_FIELD_NUMBER: _ClassVar[int]
    command_id: int
    view_direction: _containers.RepeatedScalarFieldContainer[float]
    purpose: str
    def __init__(self, command_id: _Optional[int] = ..., view_direction: _Optional[_Iterable[float]] = ..., purpose: _Optional[str] = ...) -> None: ...

class Stop(_message.Message):
    __slots__ = ("command_id", "reason")
    COMMAND_ID_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    command_id: int
    reason: str
    def __init__(self, command_id: _Optional[int] = ..., reason: _Optional[str] = ...) -> None: ...

class Estimate(_message.Message):
    __slots__ = ("stamp_ns", "iteration", "phase", "candidates", "comparisons", "travel_rad", "target", "unknown", "note")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    COMPARISONS_FIELD_NUMBER: _ClassVar[int]
    TRAVEL_RAD_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_FIELD_NUMBER: _ClassVar[int]
    NOTE_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    iteration: int
    phase: str
    candidates: _containers.RepeatedCompositeFieldContainer[CandidateEstimate]
    comparisons: int
    travel_rad: float
    target: _containers.RepeatedScalarFieldContainer[float]
    unknown: float
    note: str
    def __init__(self, stamp_ns: _Optional[int] = ..., iteration: _Optional[int] = ..., phase: _Optional[str] = ..., candidates: _Optional[_Iterable[_Union[CandidateEstimate, _Mapping]]] = ..., comparisons: _Optional[int] = ..., travel_rad: _Optional[float] = ..., target: _Optional[_Iterable[float]] = ..., unknown: _Optional[float] = ..., note: _Optional[str] = ...) -> None: ...

class CandidateEstimate(_message.Message):
    __slots__ = ("name", "rating", "w0", "w1", "w2", "rotation", "variance", "converged", "hypotheses", "probability")
    NAME_FIELD_NUMBER: _ClassVar[int]
    RATING_FIELD_NUMBER: _ClassVar[int]
    W0_FIELD_NUMBER: _ClassVar[int]
    W1_FIELD_NUMBER: _ClassVar[int]
    W2_FIELD_NUMBER: _ClassVar[int]
    ROTATION_FIELD_NUMBER: _ClassVar[int]
    VARIANCE_FIELD_NUMBER: _ClassVar[int]
    CONVERGED_FIELD_NUMBER: _ClassVar[int]
    HYPOTHESES_FIELD_NUMBER: _ClassVar[int]
    PROBABILITY_FIELD_NUMBER: _ClassVar[int]
    name: str
    rating: float
    w0: float
    w1: float
    w2: float
    rotation: _containers.RepeatedScalarFieldContainer[float]
    variance: float
    converged: bool
    hypotheses: int
    probability: float
    def __init__(self, name: _Optional[str] = ..., rating: _Optional[float] = ..., w0: _Optional[float] = ..., w1: _Optional[float] = ..., w2: _Optional[float] = ..., rotation: _Optional[_Iterable[float]] = ..., variance: _Optional[float] = ..., converged: _Optional[bool] = ..., hypotheses: _Optional[int] = ..., probability: _Optional[float] = ...) -> None: ...

class Result(_message.Message):
    __slots__ = ("stamp_ns", "outcome", "object", "reason", "ratings", "rotation", "looks", "travel_rad", "comparisons", "indistinct", "telling_view", "pose_spread_rad")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    OBJECT_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    RATINGS_FIELD_NUMBER: _ClassVar[int]
    ROTATION_FIELD_NUMBER: _ClassVar[int]
    LOOKS_FIELD_NUMBER: _ClassVar[int]
    TRAVEL_RAD_FIELD_NUMBER: _ClassVar[int]
    COMPARISONS_FIELD_NUMBER: _ClassVar[int]
    INDISTINCT_FIELD_NUMBER: _ClassVar[int]
    TELLING_VIEW_FIELD_NUMBER: _ClassVar[int]
    POSE_SPREAD_RAD_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    outcome: str
    object: str
    reason: str
    ratings: _containers.RepeatedCompositeFieldContainer[Rating]
    rotation: _containers.RepeatedScalarFieldContainer[float]
    looks: int
    travel_rad: float
    comparisons: int
    indistinct: _containers.RepeatedScalarFieldContainer[str]
    telling_view: _containers.RepeatedScalarFieldContainer[float]
    pose_spread_rad: float
    def __init__(self, stamp_ns: _Optional[int] = ..., outcome: _Optional[str] = ..., object: _Optional[str] = ..., reason: _Optional[str] = ..., ratings: _Optional[_Iterable[_Union[Rating, _Mapping]]] = ..., rotation: _Optional[_Iterable[float]] = ..., looks: _Optional[int] = ..., travel_rad: _Optional[float] = ..., comparisons: _Optional[int] = ..., indistinct: _Optional[_Iterable[str]] = ..., telling_view: _Optional[_Iterable[float]] = ..., pose_spread_rad: _Optional[float] = ...) -> None: ...

class Rating(_message.Message):
    __slots__ = ("name", "rating")
    NAME_FIELD_NUMBER: _ClassVar[int]
    RATING_FIELD_NUMBER: _ClassVar[int]
    name: str
    rating: float
    def __init__(self, name: _Optional[str] = ..., rating: _Optional[float] = ...) -> None: ...

class Keyframe(_message.Message):
    __slots__ = ("stamp_ns", "state")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    state: bytes
    def __init__(self, stamp_ns: _Optional[int] = ..., state: _Optional[bytes] = ...) -> None: ...

class Picture(_message.Message):
    __slots__ = ("stamp_ns", "sequence", "jpeg", "mask_png", "width", "height", "left", "top", "drops")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    JPEG_FIELD_NUMBER: _ClassVar[int]
    MASK_PNG_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    LEFT_FIELD_NUMBER: _ClassVar[int]
    TOP_FIELD_NUMBER: _ClassVar[int]
    DROPS_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    sequence: int
    jpeg: bytes
    mask_png: bytes
    width: int
    height: int
    left: int
    top: int
    drops: int
    def __init__(self, stamp_ns: _Optional[int] = ..., sequence: _Optional[int] = ..., jpeg: _Optional[bytes] = ..., mask_png: _Optional[bytes] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., left: _Optional[int] = ..., top: _Optional[int] = ..., drops: _Optional[int] = ...) -> None: ...

class Look(_message.Message):
    __slots__ = ("stamp_ns", "problem", "percept", "picture")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    PERCEPT_FIELD_NUMBER: _ClassVar[int]
    PICTURE_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    problem: str
    percept: Percept
    picture: Picture
    def __init__(self, stamp_ns: _Optional[int] = ..., problem: _Optional[str] = ..., percept: _Optional[_Union[Percept, _Mapping]] = ..., picture: _Optional[_Union[Picture, _Mapping]] = ...) -> None: ...
