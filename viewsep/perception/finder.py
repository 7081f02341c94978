"""From a camera's frame to one that shows the object alone: found, judged, cut out, and remembered for the next."""

from __future__ import annotations

from collections.abc import Sequence

from viewsep.errors import BadInput
from viewsep.messages import Frame
from viewsep.perception.boxes import whole
from viewsep.perception.crop import enclosing_circle, squared
from viewsep.perception.exposure import badly_exposed
from viewsep.perception.figure_ground import Figure, FigureGround
from viewsep.perception.notices import Watch
from viewsep.perception.tracking import CREDIBLE_AFTER, Track

ANOTHER = "the object is another one, or held otherwise"
FORGET_NS = 10_000_000_000  # after that without a frame nothing is known of where the object is, or which


class ObjectFinder:
    """Makes square frames with a mask, as those of the simulated camera, from frames without one.

    The object's bounding sphere fills a picture of `size_px` as in renders. Its radius in the camera's pixels is
    `radius_px`, or with 0 that of the largest circle around the object's mask so far. `track`, `circle_px`
    and `watch` are all that is remembered. `notes` and `anew` are those of the frame found last, as in `Percept`.
    """

    def __init__(self, figure_ground: FigureGround, size_px: int, radius_px: float = 0.0) -> None:
        self.figure_ground = figure_ground
        self.size_px = size_px
        self.radius_px = radius_px
        self.track = Track()
        self.circle_px = 0.0
        self.watch = Watch()
        self.notes: tuple[str, ...] = ()
        self.anew = ""
        self._newest_ns: int | None = None

    def find(self, frame: Frame, joints: Sequence[float]) -> Frame:
        """The frame's object at joint angles (n,), cut out. Raises BadInput with a sentence when no mask is good."""
        if self._newest_ns is not None and frame.stamp_ns - self._newest_ns > FORGET_NS:
            self.track, self.circle_px, self.watch = Track(), 0.0, self.watch.unseen(self._newest_ns)
        self._newest_ns = frame.stamp_ns
        before = self.track
        figure = self.figure_ground.segment(frame.image, joints, before)
        self.track = figure.track
        if figure.problem:
            if figure.quality.absent:
                self.watch = self.watch.missing(frame.stamp_ns)
            raise BadInput("; ".join(filter(None, [figure.problem, badly_exposed(frame.image)])))
        another = len(before.doubted) == CREDIBLE_AFTER
        self._notice(figure, frame.stamp_ns, another)
        box = self.track.box or whole(frame.image.shape[:2])
        x, y, radius_px = enclosing_circle(figure.mask[box.part])
        if another:
            self.circle_px = 0.0
        self.circle_px = max(self.circle_px, radius_px)
        cut = squared(
            frame.image, figure.mask, (x + box.left, y + box.top), self.radius_px or self.circle_px, self.size_px
        )
        return Frame(frame.stamp_ns, frame.sequence, *cut)

    def _notice(self, figure: Figure, stamp_ns: int, another: bool) -> None:
        """What there is to say of a good figure; `another` object may be shown than before."""
        away = self.watch.was_away(stamp_ns)
        changed = "" if figure.light is None else self.watch.changed(figure.light)
        self.watch = self.watch.found(figure.light)
        self.notes = (changed,) if changed else ()
        self.anew = away or (ANOTHER if another else "")
