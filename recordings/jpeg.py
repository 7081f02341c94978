"""The size of a picture, from its JPEG's header alone."""

from __future__ import annotations

from viewsep.errors import BadRecording

_SIZES = {0xC0, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}  # segments that tell the size


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Width and height in pixels. Raises BadRecording for anything but a JPEG."""
    at = 2
    while data[:2] == b"\xff\xd8" and at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _SIZES:
            return int.from_bytes(data[at + 7 : at + 9], "big"), int.from_bytes(data[at + 5 : at + 7], "big")
        at += 1 if marker == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    raise BadRecording(f"a picture of {len(data)} bytes is not a JPEG; record again")
