"""Placement: where on the table a part, or the base of an arm, lies best."""

from armcontour.jobs.place_search import AXES, MIDDLE, OBJECTIVES, ORIGIN, UNITS, WHAT, Axis
from armcontour.studies.placement.best_place import place
from armcontour.studies.placement.place_evaluation import KINDS, Verdict
from armcontour.studies.placement.placed_job import Moves, place_job
from armcontour.studies.placement.placement import Place, Placement

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
