"""What flows from step to step: joint paths, trajectories, taught data, executions."""

from armcontour.motion.execution import Execution
from armcontour.motion.joint_path import JointPath, quintic
from armcontour.motion.laws import (
    LapLaw,
    Law,
    LawAlongPath,
    LineLaw,
    PathLaw,
    Rates,
    interval_times,
)
from armcontour.motion.smoothing import SmoothedLaw, smoothed
from armcontour.motion.taught import TaughtData, checked_interval
from armcontour.motion.trajectory import Method, Samples, Span, Stretch, TimedEvent, Trajectory

__all__ = [
    "Execution",
    "JointPath",
    "LapLaw",
    "Law",
    "LawAlongPath",
    "LineLaw",
    "Method",
    "PathLaw",
    "Rates",
    "Samples",
    "SmoothedLaw",
    "Span",
    "Stretch",
    "TaughtData",
    "TimedEvent",
    "Trajectory",
    "checked_interval",
    "interval_times",
    "quintic",
    "smoothed",
]
