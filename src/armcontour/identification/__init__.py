"""Identification from logs: of independent servos, or of an arm with masses (`bodies`)."""

from armcontour.identification.bodies.body_identification import BodyIdentification, BodyJoint
from armcontour.identification.bodies.identifying import identify_bodies
from armcontour.identification.estimates import Estimate
from armcontour.identification.options import BodyFit, FitOptions, ServoFit
from armcontour.identification.results import (
    Identification,
    JointIdentification,
    Judgement,
    Prediction,
)
from armcontour.identification.servos import identify
from armcontour.motion.log import INTERPOLATIONS, Log, cut

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
    "cut",
    "identify",
    "identify_bodies",
]
