"""Certificates: the fastest motion that keeps a goal on every robot of a box."""

from armcontour.certification.certificate import (
    Budget,
    Certificate,
    ContourCertificate,
    Uncertified,
)
from armcontour.certification.certifying import certify
from armcontour.certification.sweeping import SweepPoint, sweep

__all__ = [
    "Budget",
    "Certificate",
    "ContourCertificate",
    "SweepPoint",
    "Uncertified",
    "certify",
    "sweep",
]
