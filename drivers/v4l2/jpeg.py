"""Whether a JPEG is whole, by its structure.

Decoders fill in what is missing: of a picture that lost its middle on the way OpenCV (libjpeg) makes one whose rest is
wrong, prints "Corrupt JPEG data" and reports no error. The markers tell most of that. What they cannot tell: damage
between two markers of a picture without restart markers.
"""

from __future__ import annotations

import re

START, END, SCAN, RESTART_INTERVAL = 0xD8, 0xD9, 0xDA, 0xDD
FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # headers with the picture's size; the others are tables
RESTART_FIRST, RESTARTS = 0xD0, 8
MARKER = re.compile(rb"\xff+([^\x00\xff])")  # in the coded data 0xff is followed by 0 unless it begins a marker


def fault(data: bytes, width: int, height: int) -> str:
    """What is wrong with a JPEG that should have this size; empty where nothing is seen to be."""
    if data[:2] != b"\xff\xd8":
        return "it does not begin as a JPEG"
    at, interval, blocks = 2, 0, 0
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            return f"byte {at} is no marker"
        kind = data[at + 1]
        if kind == 0xFF:  # padding
            at += 1
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        segment = data[at + 4 : at + 2 + length]
        if length < 2 or len(segment) != length - 2:
            return "it ends within its header"
        if kind in FRAMES:
            if len(segment) < 6 or len(segment) < 6 + 3 * segment[5]:
                return "its header is damaged"
            size = int.from_bytes(segment[3:5], "big"), int.from_bytes(segment[1:3], "big")
            if size != (width, height):
                return f"it is {size[0]} x {size[1]} instead of {width} x {height}"
            blocks = _blocks(segment, width, height)
        elif kind == RESTART_INTERVAL:
            interval = int.from_bytes(segment[:2], "big")
        at += 2 + length
        if kind == SCAN:
            return _scan_fault(data, at, -(-blocks // interval) - 1 if interval and blocks else None)
    return "it ends within its header"


def _scan_fault(data: bytes, at: int, restarts: int | None) -> str:
    """Of the coded data from `at` on: restart markers in their order, as many as there should be, then the end."""
    for seen, match in enumerate(MARKER.finditer(data, at)):
        kind = match[1][0]
        if kind == END:
            if restarts is not None and seen != restarts:
                return f"it has {seen} of {restarts} restart markers: a part is missing"
            return ""
        if kind != RESTART_FIRST + seen % RESTARTS:
            return f"marker {kind:#x} in the picture where none such belongs"
    return "its end is missing"


def _blocks(header: bytes, width: int, height: int) -> int:
    """How many units of 8 x 8 pixels times the largest sampling factors it takes; 0 where the header tells none."""
    factors = [header[7 + 3 * i] for i in range(header[5])]
    across, down = (max((f >> 4 for f in factors), default=0), max((f & 15 for f in factors), default=0))
    return -(-width // (8 * across)) * -(-height // (8 * down)) if across and down else 0
