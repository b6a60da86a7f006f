"""Iterative learning control: set-points of the next run from logs of earlier runs."""

from armcontour.control.learning.learner import learn
from armcontour.control.learning.learning_result import LearningResult, LearningRun, Recording

__all__ = ["LearningRun", "LearningResult", "Recording", "learn"]
