"""Certificates: the fastest plan whose execution satisfies a goal on every robot of a box."""

from armcontour.studies.certification.certificate import Certificate
from armcontour.studies.certification.certification import certify

__all__ = ["Certificate", "certify"]
