"""Learning from run to run: set-points from what the joints did with those before."""

from armcontour.control.learning.learner import judge_run, learn
from armcontour.control.learning.lesson import LearnedRun, Lesson, Recording

__all__ = ["LearnedRun", "Lesson", "Recording", "judge_run", "learn"]
