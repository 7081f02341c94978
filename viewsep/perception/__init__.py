"""From frames to percepts: where the object is in the picture, what it looks like, and from where it is seen."""

from viewsep.perception.rig_perception import RigPerception, perceive, position_at

__all__ = ["RigPerception", "perceive", "position_at"]
