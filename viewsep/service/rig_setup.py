"""From configuration to the rig that a process serves."""

from __future__ import annotations

from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.models.aspect_graph import AspectGraph
from viewsep.rigs import rig_holding
from viewsep.service.catalogue import Catalogue
from viewsep.service.hardware import SharedCamera, SharedMotion
from viewsep.service.lease import Lease
from viewsep.service.served_rig import ServedRig
from viewsep.sim.source import absolute_source
