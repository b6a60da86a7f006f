"""Learning from run to run: set-points from what the joints did with those before."""

from armcontour.learning.learner import judge_run, learn
from armcontour.learning.lesson import LearnedRun, Lesson, Recording

__all__ = ["LearnedRun", "Lesson", "Recording", "judge_run", "learn"]
