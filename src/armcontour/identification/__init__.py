"""Identification of the servo from a log; uses only the servo model of the other packages."""

from armcontour.identification.identification import MODELS, identify
from armcontour.identification.log import INTERPOLATIONS, Log, cut
from armcontour.identification.results import Estimate, Identification, JointIdentification

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
