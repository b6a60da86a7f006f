"""Learning from run to run: set-points from what the joints did with those before."""

from armcontour.control.learning.learner import judge_run, learn
from armcontour.control.learning.lesson import LearningResult, LearningRun, Recording

__all__ = ["LearningRun", "LearningResult", "Recording", "judge_run", "learn"]
