"""Placement: where on the table a part, or the base of an arm, lies best."""

from armcontour.jobs.axes import AXES, UNITS, Axis
from armcontour.jobs.place_search import MIDDLE, OBJECTIVES, ORIGIN, WHAT
from armcontour.placement.judging import KINDS, Verdict
from armcontour.placement.moving import Moves, place_job
from armcontour.placement.placement import Case, Place, Placement, best_case
from armcontour.placement.placing import place
from armcontour.placement.searching import shown
from armcontour.placement.variants import with_arm, with_tool

__all__ = [
    "AXES",
    "KINDS",
    "MIDDLE",
    "OBJECTIVES",
    "ORIGIN",
    "UNITS",
    "WHAT",
    "Axis",
    "Case",
    "Moves",
    "Place",
    "Placement",
    "Verdict",
    "best_case",
    "place",
    "place_job",
    "shown",
    "with_arm",
    "with_tool",
]
