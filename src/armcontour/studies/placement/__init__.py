"""Placement: where on the table a part, or the base of an arm, lies best."""

from armcontour.jobs.axes import AXES, UNITS, Axis
from armcontour.jobs.place_search import MIDDLE, OBJECTIVES, ORIGIN, WHAT
from armcontour.studies.placement.judging import KINDS, Verdict
from armcontour.studies.placement.moving import Moves, place_job
from armcontour.studies.placement.placement import Place, Placement
from armcontour.studies.placement.placing import place

__all__ = [
    "AXES",
    "KINDS",
    "MIDDLE",
    "OBJECTIVES",
    "ORIGIN",
    "UNITS",
    "WHAT",
    "Axis",
    "Moves",
    "Place",
    "Placement",
    "Verdict",
    "place",
    "place_job",
]
