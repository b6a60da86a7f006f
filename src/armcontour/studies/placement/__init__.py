"""Placement: search for the best position of a part, or of the base of an arm."""

from armcontour.jobs.placement_options import AXES, MIDDLE, OBJECTIVES, ORIGIN, UNITS, WHAT, Axis
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
