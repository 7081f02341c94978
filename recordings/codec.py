"""Messages to protobuf and back, exactly: what is decoded encodes to the same bytes.

The schemas stand in `schemas/viewsep.proto`. Frames are the exception: a picture is kept as a JPEG, its mask as a PNG.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import Message as Protobuf
from google.protobuf.timestamp_pb2 import Timestamp

from viewsep import messages
from viewsep.errors import BadInput, BadRecording
from viewsep.messages import Array, FloatArray, Frame, Outcome, Phase
from viewsep.recordings.schemas import viewsep_pb2 as pb

Recordable: TypeAlias = (
    messages.JointState | messages.Event | messages.Command | messages.Estimate | messages.Result | messages.Keyframe
)
"""What `encode` takes: every message but `Frame`, which has a codec of its own, and `HypothesisViews`, which decides
nothing and is only shown."""

IMAGE_TOPIC = "camera/image"
MASK_TOPIC = "camera/mask"
PICTURES = (IMAGE_TOPIC, MASK_TOPIC)
CAMERA_FRAME = "camera"
"""The frame that pictures are in: x to the right, y down, z into the picture."""

SCHEMAS: Mapping[str, type[Protobuf]] = {
    IMAGE_TOPIC: CompressedImage,
    MASK_TOPIC: CompressedImage,
    "motion/state": pb.JointState,
    "percept": pb.Percept,
    "event": pb.Event,
    "command": pb.Command,
    "estimate": pb.Estimate,
    "result": pb.Result,
    "engine/state": pb.Keyframe,
}
"""Every topic of a recording and the protobuf message on it."""

# without chroma subsampling: it would blur the red and green that descriptors live on
JPEG_OPTIONS = [cv2.IMWRITE_JPEG_QUALITY, 98, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
_NS_PER_S = 1_000_000_000


def encode(message: Recordable) -> tuple[str, Protobuf]:
    """The topic `message` is recorded on and its protobuf form.

    Raises BadInput where the schema cannot hold the message exactly: an array of another shape or type, an integer
    beyond 64 bits, text that is not Unicode.
    """
    try:
        return _encode(message)
    except ValueError as error:
        raise BadInput(f"{type(message).__name__} cannot be recorded: {error}; correct whatever made it") from error


def decode(topic: str, protobuf: Protobuf) -> Recordable:
    """The message that `encode` turned into `topic` and `protobuf`.

    Raises BadRecording for a topic or type that is not recorded here, an event or command of an unknown kind, an
    unknown phase or outcome, and arrays of the wrong length.
    """
    expected = SCHEMAS.get(topic)
    if expected is None or expected is CompressedImage or not isinstance(protobuf, expected):
        raise BadRecording(f"topic {topic!r} does not hold {protobuf.DESCRIPTOR.full_name}; update viewsep")
    try:
        return _decode(protobuf)
    except ValueError as error:
        raise BadRecording(f"{protobuf.DESCRIPTOR.full_name}: {error}; update viewsep or record again") from error


def to_bytes(message: Recordable) -> bytes:
    """`message` as the bytes that are recorded; equal bytes mean equal content. Raises BadInput as `encode` does."""
    return serialise(encode(message)[1])


def serialise(protobuf: Protobuf) -> bytes:
    """The deterministic serialisation that recordings hold."""
    return protobuf.SerializeToString(deterministic=True)


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """A frame as it is kept: `jpeg` holds the RGB picture, `mask_png` the mask or None where the frame has none."""

    stamp_ns: int
    sequence: int
    jpeg: bytes
    mask_png: bytes | None

    def decode(self) -> Frame:
        """The frame, its picture with JPEG's small errors, its mask exact. Raises BadRecording when it is damaged."""
        image = cv2.cvtColor(_decompress(self.jpeg, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        mask = None if self.mask_png is None else _decompress(self.mask_png, cv2.IMREAD_GRAYSCALE) > 0
        if mask is not None and mask.shape != image.shape[:2]:
            raise BadRecording(f"frame {self.sequence}: its mask is {mask.shape}, not {image.shape[:2]}; record again")
        return Frame(self.stamp_ns, self.sequence, image, mask)


def encode_frame(frame: Frame) -> tuple[tuple[str, CompressedImage], ...]:
    """The frame's mask (if it has one), then its picture, each with its topic.

    Raises BadInput unless the picture is (H, W, 3) uint8 with at least one pixel and the mask (H, W) bool.
    """
    image, mask = frame.image, frame.mask
    picture = (IMAGE_TOPIC, encode_picture(frame))
    if mask is None:
        return (picture,)
    if mask.shape != image.shape[:2] or mask.dtype != np.bool_:
        raise BadInput(f"frame {frame.sequence}: its mask is {mask.shape} {mask.dtype}, give {image.shape[:2]} bool")
    png = _compress(".png", mask.astype(np.uint8) * 255, [])
    return ((MASK_TOPIC, _compressed_image(frame, png, "png")), picture)


def encode_picture(frame: Frame) -> CompressedImage:
    """The frame's picture alone. Raises BadInput unless it is (H, W, 3) uint8 with at least one pixel."""
    image = frame.image
    if image.ndim != 3 or image.shape[2] != 3 or image.size == 0 or image.dtype != np.uint8:
        raise BadInput(f"frame {frame.sequence}: its image is {image.shape} {image.dtype}, give (H, W, 3) uint8")
    jpeg = _compress(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), JPEG_OPTIONS)
    return _compressed_image(frame, jpeg, "jpeg")


def decode_frame(sequence: int, image: CompressedImage, mask: CompressedImage | None) -> RecordedFrame:
    """The recorded frame whose picture is `image`; nothing is decompressed yet."""
    stamp_ns = image.timestamp.seconds * _NS_PER_S + image.timestamp.nanos
    return RecordedFrame(stamp_ns, sequence, image.data, None if mask is None else mask.data)


def _compressed_image(frame: Frame, data: bytes, kind: str) -> CompressedImage:
    stamp = Timestamp(seconds=frame.stamp_ns // _NS_PER_S, nanos=frame.stamp_ns % _NS_PER_S)
    return CompressedImage(timestamp=stamp, frame_id=CAMERA_FRAME, data=data, format=kind)


def _compress(extension: str, image: Array, options: list[int]) -> bytes:
    try:
        _, data = cv2.imencode(extension, image, options)
    except cv2.error as error:
        raise BadInput(f"an image of {image.shape} cannot be compressed: {error.err}; give a smaller one") from error
    return data.tobytes()


def _decompress(data: bytes, flags: int) -> npt.NDArray[np.uint8]:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    if image is None:
        raise BadRecording(f"an image of {len(data)} bytes is neither JPEG nor PNG; record again")
    return image.astype(np.uint8, copy=False)


def _encode(message: Recordable) -> tuple[str, Protobuf]:
    match message:
        case messages.JointState(stamp_ns, position, setpoint, moving, fault):
            return "motion/state", pb.JointState(
                stamp_ns=stamp_ns, position_rad=position, setpoint_rad=setpoint, moving=moving, fault=fault
            )
        case messages.PerceptReceived(percept):
            return "percept", _encode_percept(percept)
        case messages.MoveTo() | messages.Stop():
            return "command", _encode_command(message)
        case messages.Estimate():
            return "estimate", _encode_estimate(message)
        case messages.Result():
            return "result", _encode_result(message)
        case messages.Keyframe(stamp_ns, state):
            return "engine/state", pb.Keyframe(stamp_ns=stamp_ns, state=state)
        case _:
            return "event", _encode_event(message)


def _decode(protobuf: Protobuf) -> Recordable:
    match protobuf:
        case pb.JointState() as state:
            return messages.JointState(
                state.stamp_ns, tuple(state.position_rad), tuple(state.setpoint_rad), state.moving, state.fault
            )
        case pb.Percept():
            return messages.PerceptReceived(_decode_percept(protobuf))
        case pb.Event():
            return _decode_event(protobuf)
        case pb.Command():
            return _decode_command(protobuf)
        case pb.Estimate():
            return _decode_estimate(protobuf)
        case pb.Result():
            return _decode_result(protobuf)
        case pb.Keyframe():
            return messages.Keyframe(protobuf.stamp_ns, protobuf.state)
        case _:
            raise ValueError("no message of this type is recorded")


def _encode_percept(percept: messages.Percept) -> pb.Percept:
    feature = percept.feature
    if feature.ndim != 1 or feature.dtype != np.float32:
        raise ValueError(f"feature is {feature.shape} {feature.dtype} instead of (D,) float32")
    return pb.Percept(
        stamp_ns=percept.stamp_ns,
        sequence=percept.sequence,
        descriptor=percept.descriptor,
        feature=feature.tolist(),
        view_direction=_flat("view_direction", percept.view_direction, (3,)),
        notes=percept.notes,
        anew=percept.anew,
    )


def _decode_percept(percept: pb.Percept) -> messages.Percept:
    return messages.Percept(
        percept.stamp_ns,
        percept.sequence,
        percept.descriptor,
        np.array(percept.feature, np.float32),
        _array("view_direction", percept.view_direction, (3,)),
        tuple(percept.notes),
        percept.anew,
    )


def _encode_event(event: messages.Event) -> pb.Event:
    match event:
        case messages.TaskStarted(stamp_ns, seed, view):
            flat = _flat("view_direction", view, (3,))
            return pb.Event(task_started=pb.TaskStarted(stamp_ns=stamp_ns, seed=seed, view_direction=flat))
        case messages.MoveSettled(stamp_ns, command_id):
            return pb.Event(move_settled=pb.MoveSettled(stamp_ns=stamp_ns, command_id=command_id))
        case messages.MoveFailed(stamp_ns, command_id, reason):
            return pb.Event(move_failed=pb.MoveFailed(stamp_ns=stamp_ns, command_id=command_id, reason=reason))
        case messages.FrameMissing(stamp_ns, reason):
            return pb.Event(frame_missing=pb.FrameMissing(stamp_ns=stamp_ns, reason=reason))
        case messages.DeadlinePassed(stamp_ns):
            return pb.Event(deadline_passed=pb.DeadlinePassed(stamp_ns=stamp_ns))
        case messages.CancelRequested(stamp_ns, reason):
            return pb.Event(cancel_requested=pb.CancelRequested(stamp_ns=stamp_ns, reason=reason))
        case messages.RigFailed(stamp_ns, reason):
            return pb.Event(rig_failed=pb.RigFailed(stamp_ns=stamp_ns, reason=reason))
        case _:
            raise ValueError("there is no schema for it")


def _decode_event(event: pb.Event) -> messages.Event:
    match event.WhichOneof("kind"):
        case "task_started":
            started = event.task_started
            view = _array("view_direction", started.view_direction, (3,))
            return messages.TaskStarted(started.stamp_ns, started.seed, view)
        case "move_settled":
            return messages.MoveSettled(event.move_settled.stamp_ns, event.move_settled.command_id)
        case "move_failed":
            failed = event.move_failed
            return messages.MoveFailed(failed.stamp_ns, failed.command_id, failed.reason)
        case "frame_missing":
            return messages.FrameMissing(event.frame_missing.stamp_ns, event.frame_missing.reason)
        case "deadline_passed":
            return messages.DeadlinePassed(event.deadline_passed.stamp_ns)
        case "cancel_requested":
            return messages.CancelRequested(event.cancel_requested.stamp_ns, event.cancel_requested.reason)
        case "rig_failed":
            return messages.RigFailed(event.rig_failed.stamp_ns, event.rig_failed.reason)
        case _:
            raise ValueError("an event of an unknown kind")


def _encode_command(command: messages.Command) -> pb.Command:
    match command:
        case messages.MoveTo(command_id, view, purpose):
            flat = _flat("view_direction", view, (3,))
            return pb.Command(move_to=pb.MoveTo(command_id=command_id, view_direction=flat, purpose=purpose))
        case messages.Stop(command_id, reason):
            return pb.Command(stop=pb.Stop(command_id=command_id, reason=reason))


def _decode_command(command: pb.Command) -> messages.Command:
    match command.WhichOneof("kind"):
        case "move_to":
            move = command.move_to
            view = _array("view_direction", move.view_direction, (3,))
            return messages.MoveTo(move.command_id, view, Phase(move.purpose))
        case "stop":
            return messages.Stop(command.stop.command_id, command.stop.reason)
        case _:
            raise ValueError("a command of an unknown kind")


def _encode_estimate(estimate: messages.Estimate) -> pb.Estimate:
    return pb.Estimate(
        stamp_ns=estimate.stamp_ns,
        iteration=estimate.iteration,
        phase=estimate.phase,
        candidates=[_encode_candidate(candidate) for candidate in estimate.candidates],
        comparisons=estimate.comparisons,
        travel_rad=estimate.travel_rad,
        target=None if estimate.target is None else _flat("target", estimate.target, (3,)),
        unknown=estimate.unknown,
        note=estimate.note,
    )


def _decode_estimate(estimate: pb.Estimate) -> messages.Estimate:
    return messages.Estimate(
        estimate.stamp_ns,
        estimate.iteration,
        Phase(estimate.phase),
        tuple(_decode_candidate(candidate) for candidate in estimate.candidates),
        estimate.comparisons,
        estimate.travel_rad,
        _array("target", estimate.target, (3,)) if estimate.target else None,
        estimate.unknown if estimate.HasField("unknown") else None,
        estimate.note,
    )


def _encode_candidate(candidate: messages.CandidateEstimate) -> pb.CandidateEstimate:
    return pb.CandidateEstimate(
        name=candidate.name,
        rating=candidate.rating,
        w0=candidate.w0,
        w1=candidate.w1,
        w2=candidate.w2,
        rotation=_flat("rotation", candidate.rotation, (3, 3)),
        variance=candidate.variance,
        converged=candidate.converged,
        hypotheses=candidate.hypotheses,
        probability=candidate.probability,
    )


def _decode_candidate(candidate: pb.CandidateEstimate) -> messages.CandidateEstimate:
    return messages.CandidateEstimate(
        candidate.name,
        candidate.rating,
        candidate.w0,
        candidate.w1,
        candidate.w2,
        _array("rotation", candidate.rotation, (3, 3)),
        candidate.variance,
        candidate.converged,
        candidate.hypotheses,
        candidate.probability if candidate.HasField("probability") else None,
    )


def _encode_result(result: messages.Result) -> pb.Result:
    return pb.Result(
        stamp_ns=result.stamp_ns,
        outcome=result.outcome,
        object=result.object,
        reason=result.reason,
        ratings=[pb.Rating(name=name, rating=rating) for name, rating in result.ratings],
        rotation=_flat("rotation", result.rotation, (3, 3)),
        looks=result.looks,
        travel_rad=result.travel_rad,
        comparisons=result.comparisons,
        indistinct=result.indistinct,
        telling_view=None if result.telling_view is None else _flat("telling_view", result.telling_view, (3,)),
        pose_spread_rad=result.pose_spread_rad,
    )


def _decode_result(result: pb.Result) -> messages.Result:
    return messages.Result(
        result.stamp_ns,
        Outcome(result.outcome),
        result.object,
        result.reason,
        tuple((rating.name, rating.rating) for rating in result.ratings),
        _array("rotation", result.rotation, (3, 3)),
        result.looks,
        result.travel_rad,
        result.comparisons,
        tuple(result.indistinct),
        _array("telling_view", result.telling_view, (3,)) if result.telling_view else None,
        result.pose_spread_rad if result.HasField("pose_spread_rad") else None,
    )


def _flat(name: str, array: FloatArray, shape: tuple[int, ...]) -> list[float]:
    if array.shape != shape or array.dtype != np.float64:
        raise ValueError(f"{name} is {array.shape} {array.dtype} instead of {shape} float64")
    return [float(value) for value in array.ravel()]


def _array(name: str, values: Iterable[float], shape: tuple[int, ...]) -> FloatArray:
    array = np.array(list(values), np.float64)
    if array.size != np.prod(shape):
        raise ValueError(f"{name} has {array.size} numbers instead of {shape}")
    return array.reshape(shape)
