"""Evaluation of executions and checks of trajectories, independent of the code that made them."""

from armcontour.evaluation.checking import Check, PathDeviation, check
from armcontour.evaluation.error_profile import ErrorProfile, Missed
from armcontour.evaluation.evaluation import Evaluation, evaluate
from armcontour.evaluation.pieces import CornerDeviation
from armcontour.evaluation.tally import LimitUse

__all__ = [
    "Check",
    "CornerDeviation",
    "ErrorProfile",
    "Evaluation",
    "LimitUse",
    "Missed",
    "PathDeviation",
    "check",
    "evaluate",
]
