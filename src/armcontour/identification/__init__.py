"""Identification of the servo from a log; uses only the servo model of the other packages."""

from armcontour.identification.identification import MODELS, identify
from armcontour.identification.results import Estimate, Identification, JointIdentification
from armcontour.motion.log import INTERPOLATIONS, Log, cut

__all__ = [
    "INTERPOLATIONS",
    "MODELS",
    "Estimate",
    "Identification",
    "JointIdentification",
    "Log",
    "cut",
    "identify",
]
