"""A rig's geometry as URDF: a chain of revolute joints whose axes meet in the object's centre."""

from __future__ import annotations

import math
from xml.etree import ElementTree as Xml

from viewsep.interfaces import JointLimits
from viewsep.kinematics import RigGeometry
from viewsep.messages import FloatArray

LINK_MASS_KG = 0.5
LINK_INERTIA = 0.002
EFFORT_NM = 20.0


def rig_urdf(geometry: RigGeometry) -> str:
    """URDF text with links `base`, `link_1` … `link_n`; the last link is what holds the object."""
    robot = Xml.Element("robot", name=geometry.name)
    _add_link(robot, "base")
    for number, (axis, limit) in enumerate(zip(geometry.axes, geometry.limits, strict=True), start=1):
        _add_link(robot, f"link_{number}")
        parent = "base" if number == 1 else f"link_{number - 1}"
        _add_joint(robot, axis, limit, parent, f"link_{number}")
    return Xml.tostring(robot, encoding="unicode")


def _add_link(robot: Xml.Element, name: str) -> None:
    inertial = Xml.SubElement(Xml.SubElement(robot, "link", name=name), "inertial")
    Xml.SubElement(inertial, "mass", value=str(LINK_MASS_KG))
    moments = {key: str(LINK_INERTIA if key in ("ixx", "iyy", "izz") else 0) for key in _MOMENTS}
    Xml.SubElement(inertial, "inertia", moments)


_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def _add_joint(robot: Xml.Element, axis: FloatArray, limit: JointLimits, parent: str, child: str) -> None:
    free = math.isinf(limit.lower_rad) and math.isinf(limit.upper_rad)
    joint = Xml.SubElement(robot, "joint", name=limit.name, type="continuous" if free else "revolute")
    Xml.SubElement(joint, "parent", link=parent)
    Xml.SubElement(joint, "child", link=child)
    Xml.SubElement(joint, "origin", xyz="0 0 0", rpy="0 0 0")
    Xml.SubElement(joint, "axis", xyz=" ".join(repr(float(x)) for x in axis))
    bounds = {"effort": str(EFFORT_NM), "velocity": repr(float(limit.max_speed_rad_s))}
    if not free:
        bounds |= {"lower": repr(float(limit.lower_rad)), "upper": repr(float(limit.upper_rad))}
    Xml.SubElement(joint, "limit", bounds)
