"""Identification of independent joint servos, or of an arm with masses (`bodies`), from logs."""

from armcontour.control.identification.bodies.body_identification import (
    BodyIdentification,
    BodyJoint,
)
from armcontour.control.identification.bodies.rigid_bodies import identify_bodies
from armcontour.control.identification.estimates import Estimate
from armcontour.control.identification.fit_options import BodyFit, FitOptions, ServoFit
from armcontour.control.identification.identification_result import (
    Identification,
    JointIdentification,
    Judgement,
    Prediction,
)
from armcontour.control.identification.servo_identification import identify
from armcontour.motion.log import INTERPOLATIONS, Log, cut_log

__all__ = [
    "INTERPOLATIONS",
    "BodyFit",
    "BodyIdentification",
    "BodyJoint",
    "Estimate",
    "FitOptions",
    "Identification",
    "JointIdentification",
    "Judgement",
    "Log",
    "Prediction",
    "ServoFit",
    "cut_log",
    "identify",
    "identify_bodies",
]
