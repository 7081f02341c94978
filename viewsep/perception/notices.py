"""What is out of the ordinary in pictures that can be used all the same: other light, and an object that was away."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from viewsep.messages import FloatArray

CHANGED = 1.2  # times as bright, or as dark, in any channel: automatic exposure and lamps that warm up are slower
REMEMBERED = 5  # looks that the light is compared with
AWAY = 3  # looks in a row without any object: fewer may be faults of the camera


@dataclass(frozen=True, eq=False, slots=True)
class Watch:
    """What is remembered from picture to picture; `Watch()` knows nothing.

    `lights` (3,) each are those of the last good looks; `away` counts looks without any object since the last good one,
    the first of them at `away_ns`; `blind` says that nobody looked then.
    """

    lights: tuple[FloatArray, ...] = ()
    away: int = 0
    away_ns: int = 0
    blind: bool = False

    def missing(self, stamp_ns: int) -> Watch:
        """The watch with one more look that shows no object."""
        return replace(self, away=self.away + 1, away_ns=stamp_ns if self.away == 0 else self.away_ns)

    def unseen(self, since_ns: int) -> Watch:
        """The watch when nobody has looked for so long that anything may have happened."""
        return Watch(away=AWAY, away_ns=since_ns, blind=True)

    def found(self, light: FloatArray | None) -> Watch:
        """The watch with a good look in this light (3,), None where it is not known."""
        if light is None:
            return Watch()
        before = () if self.changed(light) else self.lights
        return Watch((*before, light)[-REMEMBERED:])

    def was_away(self, stamp_ns: int) -> str:
        """What to say when the object is seen again; empty where it was not away."""
        if self.away < AWAY:
            return ""
        what = "there was no picture of the object" if self.blind else "the object was gone"
        return f"{what} for {(stamp_ns - self.away_ns) * 1e-9:.1f} s"

    def changed(self, light: FloatArray) -> str:
        """What to say of the light (3,) of a good look; empty where it is as before."""
        if not self.lights:
            return ""
        usual = np.median(self.lights, axis=0)
        factor = light / np.maximum(usual, 1e-6)
        if np.abs(np.log(np.maximum(factor, 1e-6))).max() <= np.log(CHANGED):
            return ""
        colours = "" if factor.max() / factor.min() < CHANGED else ", in another colour"
        return f"the light has changed: pictures are {factor.mean():.2g} times as bright as before{colours}"
