"""Identification of independent joint servos from logs."""

from armcontour.control.identification.identification_result import (
    Identification,
    JointIdentification,
    Judgement,
    Prediction,
)
from armcontour.control.identification.least_squares import Estimate
from armcontour.control.identification.servo_identification import ServoFit, identify
from armcontour.motion.log import INTERPOLATIONS, Log, cut_log

__all__ = [
    "INTERPOLATIONS",
    "Estimate",
    "Identification",
    "JointIdentification",
    "Judgement",
    "Log",
    "Prediction",
    "ServoFit",
    "cut_log",
    "identify",
]
