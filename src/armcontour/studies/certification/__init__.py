"""Certificates: the fastest motion that keeps a goal on every robot of a box."""

from armcontour.studies.certification.certificate import (
    Budget,
    Certificate,
    ContourCertificate,
    Uncertified,
)
from armcontour.studies.certification.certifying import certify
from armcontour.studies.certification.sweeping import SweepPoint, sweep

__all__ = [
    "Budget",
    "Certificate",
    "ContourCertificate",
    "SweepPoint",
    "Uncertified",
    "certify",
    "sweep",
]
