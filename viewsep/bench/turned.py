"""An object that is turned in simulation, without motors: a percept from whatever view is asked for."""

from __future__ import annotations

import numpy as np

from viewsep.built_rig import disturbances_of
from viewsep.config import Config, geometry_of
from viewsep.geometry import rotation_showing
from viewsep.messages import FloatArray, Percept
from viewsep.plugins import make_descriptor
from viewsep.sim.disturbances import constant_gains, disturbed
from viewsep.sim.render import Pictures


class TurnedObject:
    """Held in the `rotation` (3, 3) object -> control; `seed` decides the configured disturbances of the pictures."""

    def __init__(self, pictures: Pictures, rotation: FloatArray, config: Config, seed: int) -> None:
        self.rotation = rotation
        self._pictures = pictures
        self._descriptor = make_descriptor(config.descriptor)
        self._disturbances = disturbances_of(config.sim)
        self._camera_direction = geometry_of(config.rig).camera_direction
        self._seed = seed

    def percept(self, index: int, view: FloatArray) -> Percept:
        """Look number `index`, from the view (3,) in the control frame."""
        shown = rotation_showing(view @ self.rotation, self._camera_direction)
        image, mask = self._pictures.render(self._camera_direction, shown)
        gains = constant_gains(self._disturbances, self._seed)
        image, mask = disturbed(image, mask, self._disturbances, np.random.default_rng([self._seed, 4, index]), gains)
        return Percept(index, index, self._descriptor.name, self._descriptor.describe(image, mask), view)
