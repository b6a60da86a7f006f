"""Certificates: the fastest motion that keeps its goal on every robot of a box; sweeps of them."""

from armcontour.certification.certificate import Budget, Certificate, Uncertified, certify
from armcontour.certification.sweeping import Sweep, SweepPoint, sweep

__all__ = ["Budget", "Certificate", "Sweep", "SweepPoint", "Uncertified", "certify", "sweep"]
