"""Learning from run to run: set-points from what the joints did with those before."""

from armcontour.learning.learner import learn
from armcontour.learning.lesson import LearnedRun, Lesson, TransferredData
from armcontour.learning.recording import Recording
from armcontour.learning.transferring import transfer

__all__ = ["LearnedRun", "Lesson", "Recording", "TransferredData", "learn", "transfer"]
