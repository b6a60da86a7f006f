"""Identification from logs: of the servo alone, or of a robot with masses (`bodies`)."""

from armcontour.identification.bodies import GRAVITIES, RobotIdentification, RobotJoint
from armcontour.identification.identification import MODELS, identify
from armcontour.identification.results import (
    Estimate,
    Identification,
    JointIdentification,
    Judgement,
    Prediction,
)
from armcontour.motion.log import INTERPOLATIONS, Log, cut

__all__ = [
    "GRAVITIES",
    "INTERPOLATIONS",
    "MODELS",
    "Estimate",
    "Identification",
    "JointIdentification",
    "Judgement",
    "Prediction",
    "Log",
    "RobotIdentification",
    "RobotJoint",
    "cut",
    "identify",
]
