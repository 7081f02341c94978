"""Frames and looks on their way from the rig's process to the engine's: JPEG pictures, exact masks and percepts."""

from __future__ import annotations

from typing import Literal

import numpy as np
from google.protobuf.message import DecodeError

from viewsep.errors import RigError, ViewsepError
from viewsep.interfaces import Look
from viewsep.messages import Array, Frame, PerceptReceived
from viewsep.recordings.codec import IMAGE_TOPIC, MASK_TOPIC, RecordedFrame, decode, encode_frame, serialise, to_bytes
from viewsep.recordings.schemas import viewsep_pb2 as pb

Send = Literal["image", "crop", "descriptor"]
"""What a look brings over: the whole picture, the object cut out of it, or the percept alone."""

MARGIN_PX = 2  # around the object in a crop
WHITE = 255


def encode_look(look: Look, send: Send, drops: int) -> bytes:
    """A look as it is sent. Raises BadInput when its frame cannot be compressed."""
    message = pb.Look(stamp_ns=look.stamp_ns, problem=look.problem)
    if look.percept is not None:
        message.percept.MergeFromString(to_bytes(PerceptReceived(look.percept)))
    if send != "descriptor" and look.frame is not None:
        message.picture.CopyFrom(_picture(look.frame, drops, crop=send == "crop"))
    return serialise(message)


def decode_look(data: bytes) -> Look:
    """The look that was sent; its frame is None where no picture came along. Raises RigError."""
    try:
        message = pb.Look.FromString(data)
        percept = None
        if message.HasField("percept"):
            received = decode("percept", message.percept)
            assert isinstance(received, PerceptReceived)
            percept = received.percept
        frame = _frame(message.picture) if message.HasField("picture") else None
    except (DecodeError, ViewsepError) as error:
        raise RigError(f"a look of {len(data)} bytes from the rig cannot be read: {error}") from error
    return Look(message.stamp_ns, frame, percept, message.problem)


def encode_picture(frame: Frame, drops: int) -> bytes:
    """A frame as it is sent, whole. Raises BadInput when it cannot be compressed."""
    return serialise(_picture(frame, drops, crop=False))


def decode_picture(data: bytes) -> tuple[Frame, int]:
    """The frame that was sent, and the drops until then. Raises RigError."""
    try:
        message = pb.Picture.FromString(data)
        return _frame(message), message.drops
    except (DecodeError, ViewsepError) as error:
        raise RigError(f"a frame of {len(data)} bytes from the rig cannot be read: {error}") from error


def _picture(frame: Frame, drops: int, *, crop: bool) -> pb.Picture:
    height, width = frame.image.shape[:2]
    left = top = 0
    if crop and frame.mask is not None and frame.mask.any():
        left, top, frame = _cut_out(frame, frame.mask)
    compressed = dict(encode_frame(frame))
    return pb.Picture(
        stamp_ns=frame.stamp_ns,
        sequence=frame.sequence,
        jpeg=compressed[IMAGE_TOPIC].data,
        mask_png=compressed[MASK_TOPIC].data if MASK_TOPIC in compressed else b"",
        width=width,
        height=height,
        left=left,
        top=top,
        drops=drops,
    )


def _cut_out(frame: Frame, mask: Array) -> tuple[int, int, Frame]:
    """Left, top and the part of the frame with the object, white around it."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, left = max(0, int(rows[0]) - MARGIN_PX), max(0, int(columns[0]) - MARGIN_PX)
    part = np.s_[top : int(rows[-1]) + 1 + MARGIN_PX, left : int(columns[-1]) + 1 + MARGIN_PX]
    image = np.where(mask[part][..., None], frame.image[part], np.uint8(WHITE))
    return left, top, Frame(frame.stamp_ns, frame.sequence, image, mask[part])


def _frame(picture: pb.Picture) -> Frame:
    """The frame in its full size. Raises RigError, BadRecording."""
    part = RecordedFrame(picture.stamp_ns, picture.sequence, picture.jpeg, picture.mask_png or None).decode()
    height, width = part.image.shape[:2]
    if (height, width) == (picture.height, picture.width):
        return part
    inside = np.s_[picture.top : picture.top + height, picture.left : picture.left + width]
    image = np.full((picture.height, picture.width, 3), WHITE, np.uint8)
    if image[inside].shape != part.image.shape or part.mask is None:
        raise RigError(f"frame {picture.sequence}: its crop does not lie in the picture")
    image[inside] = part.image
    mask = np.zeros((picture.height, picture.width), np.bool_)
    mask[inside] = part.mask
    return Frame(part.stamp_ns, part.sequence, image, mask)
