"""Findings in sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from viewsep.account import view_in_words
from viewsep.geometry import azimuth_elevation
from viewsep.library_check.objects import Alone
from viewsep.library_check.pairs import LEAST_BITS, Pair, Place
from viewsep.messages import FloatArray

EVERYWHERE, ALL_OVER = 0.97, 0.75  # shares of telling views


def pair_in_words(pair: Pair) -> str:
    """What is to be known of two objects."""
    both = f"{pair.first} and {pair.second}"
    if pair.alignment is None:
        return f"{both} cannot be compared: their models have too few views in common."
    if pair.best_bits < LEAST_BITS:
        return f"{both} cannot be told apart: no view says anything about which of them it is."
    if pair.telling == 0.0:
        bits = f"the best view gives {pair.best_bits:.2f} bits"
        return f"{both}: no single look tells them apart, several from different places may; {bits}."
    if pair.telling >= EVERYWHERE:
        return f"{both} are told apart by one look from anywhere."
    share = f"from {_percent(pair.telling)} of the views one look tells them apart"
    if pair.telling >= ALL_OVER or not pair.places:
        return f"{both} differ nearly all around; {share}."
    where = " and ".join(_place(place) for place in pair.places)
    return f"{both} differ only within {where}; {share}{_way(pair.furthest_rad)}{_rig(pair)}."


def object_in_words(one: Alone) -> str:
    """What is to be known of a model alone; empty where all is well."""
    if one.again:
        return f"{one.name} must be learned again: {one.again}."
    said = []
    if one.turned is not None and one.turned.alike:
        axis = _direction(np.array(one.turned.axis))
        angle = np.degrees(one.turned.angle_rad)
        said.append(
            f"{one.name} looks nearly the same turned by {angle:.0f} deg about {axis}: "
            f"a look tells {one.turned.bits:.2f} bits about which it is."
        )
    said += [
        f"{one.name} was not learned from {_percent(share)} of all sides where {other} was, and is expected to look "
        "the same there: photos of those sides would tell whether it does."
        for other, share in one.lent
    ]
    return " ".join(said)


def worth_saying(pairs: Sequence[Pair], most: int = 10) -> list[Pair]:
    """Of pairs sorted by difficulty those that are no matter of a single look from anywhere."""
    return [pair for pair in pairs if not pair.telling >= ALL_OVER][:most]


def _place(place: Place) -> str:
    return f"{np.degrees(place.radius_rad):.0f} deg of {_direction(place.centre)}"


def _way(furthest_rad: float) -> str:
    return f", at most {np.degrees(furthest_rad):.0f} deg away" if np.isfinite(furthest_rad) else ""


def _rig(pair: Pair) -> str:
    if pair.on_rig is None:
        return ""
    return f"; on this rig, in {_percent(pair.on_rig.told)} of the poses that it may be held in"


def _direction(direction: FloatArray) -> str:
    azimuth, elevation = np.degrees(azimuth_elevation(direction)).tolist()
    return view_in_words(azimuth, elevation)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.01 else f"{100.0 * share:.1f} %"
