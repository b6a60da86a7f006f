"""Evaluation of executions. Shares only geometry and arms with what it judges."""

from armcontour.evaluation.corners import CornerDeviation
from armcontour.evaluation.error_profile import ErrorProfile
from armcontour.evaluation.evaluation import Evaluation, evaluate

__all__ = ["CornerDeviation", "ErrorProfile", "Evaluation", "evaluate"]
