"""From the configuration to what finds the object."""

from __future__ import annotations

from pathlib import Path

from viewsep.config import Config
from viewsep.perception.background import Background
from viewsep.perception.boxes import Box
from viewsep.perception.figure_ground import FigureGround, Segmenter
from viewsep.perception.finder import ObjectFinder
from viewsep.perception.plain import PlainBackdrop
from viewsep.perception.quality import Limits
from viewsep.perception.region import FixedRegion
from viewsep.perception.stored import load_background, load_holder


def finder_of(config: Config) -> ObjectFinder | None:
    """What finds the object in frames that come without a mask; None where the camera is expected to give one.

    Raises BadInput for files that cannot be used.
    """
    given = config.perception
    if given.method == "given":
        return None
    holder = load_holder(Path(given.holder)) if given.holder else None
    limits = Limits(**given.limits.model_dump())
    figure_ground: FigureGround
    match given.method:
        case "background":
            figure_ground = Segmenter(
                Background(load_background(Path(given.background))), holder, limits, given.object_radius_px
            )
        case "plain":
            figure_ground = Segmenter(PlainBackdrop(), holder, limits, given.object_radius_px)
        case "region":
            assert given.region is not None  # checked with the configuration
            left, top, width, height = given.region
            figure_ground = FixedRegion(Box(left, top, left + width, top + height), holder)
    return ObjectFinder(figure_ground, config.camera.size_px, given.object_radius_px)
