"""Learning from run to run: set-points from what the joints did with those before."""

from armcontour.learning.learner import judge_run, learn
from armcontour.learning.lesson import JudgedRun, LearnedRun, Lesson, TransferredData
from armcontour.learning.recording import Recording
from armcontour.learning.transferring import transfer

__all__ = [
    "JudgedRun",
    "LearnedRun",
    "Lesson",
    "Recording",
    "TransferredData",
    "judge_run",
    "learn",
    "transfer",
]
