"""Hardware errors in words."""

from __future__ import annotations

ALERTS = {  # bits of Hardware Error Status (70)
    0: "the input voltage is out of range: check the supply and the cables",
    2: "it is too hot: let it cool down, and lighten its load",
    3: "its encoder does not work: the servo needs repair",
    4: "it had an electrical shock, or its supply is too weak: check the supply and the wiring",
    5: "it was overloaded: remove what blocks the joint, and lighten its load",
}


def in_words(hardware_error: int) -> str:
    """What the bits of Hardware Error Status mean, with remedies; empty for none."""
    known = [text for bit, text in ALERTS.items() if hardware_error >> bit & 1]
    strange = [f"unknown error bit {bit}" for bit in range(8) if hardware_error >> bit & 1 and bit not in ALERTS]
    return "; ".join(known + strange)
