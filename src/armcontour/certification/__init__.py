"""Certificates: the fastest motion that keeps a goal on every robot of a box; sweeps of them."""

from armcontour.certification._bodies import LinearFigures
from armcontour.certification.certificate import (
    Budget,
    Certificate,
    ContourCertificate,
    Uncertified,
)
from armcontour.certification.certifying import certify
from armcontour.certification.sweeping import Sweep, SweepPoint, sweep

__all__ = [
    "Budget",
    "Certificate",
    "ContourCertificate",
    "LinearFigures",
    "Sweep",
    "SweepPoint",
    "Uncertified",
    "certify",
    "sweep",
]
