"""What all tasks of an experiment share: how objects are learned and where pictures are kept."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from viewsep.built_rig import SimulatedRig
from viewsep.camera_config import CameraConfig
from viewsep.config import Config, DescriptorConfig
from viewsep.geometry import random_rotation
from viewsep.learning import learn_object, learn_view_set
from viewsep.models.aspect_graph import AspectGraph
from viewsep.rigs import rig_holding
from viewsep.sim.render import CameraOptics, Pictures
from viewsep.sim.render_cache import RenderCache
from viewsep.sim.source import object_name, open_pictures
from viewsep.sim.view_set import is_view_set


@dataclass(frozen=True)
class Setup:
    """`views` of a mesh, or every `every`-th photo of a view set, become an object's model.

    The views of every mesh are in the same places, or `turned`, for each object in its own way, as on a rig.
    It travels to the workers; each of them learns an object when it first needs it and keeps the model.
    """

    views: int = 100
    every: int = 4
    cache: RenderCache | None = None
    turned: bool = False

    def model(self, source: str, config: Config) -> AspectGraph:
        """The aspect graph of an object. Raises BadInput, BadMesh."""
        return _model(source, config.descriptor.model_dump_json(), config.camera.model_dump_json(), self)

    def pictures(self, source: str, config: Config) -> Pictures:
        """How the object looks. Raises BadInput, BadMesh."""
        return open_pictures(source, CameraOptics(config.camera.size_px), self.cache)

    def hold(self, source: str, config: Config, seed: int) -> SimulatedRig:
        """The rig with the object in its holder. Of photos it shows those that no model is made of."""
        return rig_holding(source, [self.model(source, config)], config, seed, self.cache)


@lru_cache(maxsize=4096)
def _model(source: str, descriptor: str, camera: str, setup: Setup) -> AspectGraph:
    config = Config(
        descriptor=DescriptorConfig.model_validate_json(descriptor), camera=CameraConfig.model_validate_json(camera)
    )
    if is_view_set(Path(source)):
        return learn_view_set(Path(source), object_name(source), config, every=setup.every)
    name = object_name(source)
    turned = random_rotation(np.random.default_rng(list(name.encode()))) if setup.turned else None
    return learn_object(source, name, setup.views, config, setup.cache, turned)
