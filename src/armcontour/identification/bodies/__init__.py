"""Identification of an arm with masses and its drives; uses the nominal robot of `drives`."""

from armcontour.identification.bodies.identifying import identify_robot
from armcontour.identification.bodies.model import GRAVITIES
from armcontour.identification.bodies.results import RobotIdentification, RobotJoint

__all__ = ["GRAVITIES", "RobotIdentification", "RobotJoint", "identify_robot"]
