"""Iterative learning control: set-points of the next run from logs of earlier runs."""

from armcontour.control.learning.learner import judge_run, learn
from armcontour.control.learning.learning_result import LearningResult, LearningRun, Recording

__all__ = ["LearningRun", "LearningResult", "Recording", "judge_run", "learn"]
