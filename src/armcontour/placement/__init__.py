"""Placement: where on the table a part, or the base of an arm, lies best."""

from armcontour.jobs.axes import AXES, UNITS, Axis
from armcontour.jobs.place_search import MIDDLE, OBJECTIVES, ORIGIN, WHAT
from armcontour.placement.judging import KINDS, Verdict
from armcontour.placement.moving import Moves, place_job
from armcontour.placement.placement import Place, Placement
from armcontour.placement.placing import place

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
