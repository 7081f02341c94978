"""From configuration to the rig that a process serves."""

from __future__ import annotations

from pathlib import Path

from viewsep.config import Config
from viewsep.rigs import is_real, rig_for
from viewsep.service.catalogue import Catalogue
from viewsep.service.hardware import SharedCamera, SharedMotion
from viewsep.service.lease import Lease
from viewsep.service.served_rig import ServedRig
from viewsep.sim.source import absolute_source


def served_rig(config: Config) -> ServedRig:
    """The configured rig, shared; nothing is opened yet. Raises BadInput, BadConfig.

    A simulated rig that holds photos shows those that no model of the library was learned from, if there are any.
    """
    settings = config.service
    models = Catalogue(Path(settings.library)).models()
    real = is_real(config)
    holds = settings.holds if not real or "holds" in settings.model_fields_set else ""
    held = rig_for(config, holds, settings.seed, models=models, speed=settings.speed)
    lease = Lease(settings.lease_s)
    return ServedRig(
        config=held.config,
        motion=SharedMotion(held.rig.motion, lease),
        camera=SharedCamera(held.rig.camera, held.rig.clock, stepped=held.speed == 0),
        geometry=held.rig.geometry,
        clock=held.rig.clock,
        simulated=not real,
        pictures=held.pictures.value,
        holds=absolute_source(holds) if holds else "",
        speed=held.speed,
    )
