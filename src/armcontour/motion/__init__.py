"""Motions as values: joint paths, trajectories, taught data, executions."""

from armcontour._quintics import quintic
from armcontour.motion._intervals import interval_times
from armcontour.motion.bounding import largest_shares
from armcontour.motion.execution import (
    LONGEST_CLOCK,
    Execution,
    FineMotion,
    LimitCost,
    TaughtData,
    check_interval,
)
from armcontour.motion.joint_path import JointPath
from armcontour.motion.laws import (
    LapLaw,
    Law,
    LawAlongPath,
    LineLaw,
    PathLaw,
    Rates,
    stand_still,
)
from armcontour.motion.log import Log
from armcontour.motion.trajectory import (
    PERIOD,
    Method,
    Samples,
    Span,
    Stretch,
    TimedEvent,
    Trajectory,
)

__all__ = [
    "LONGEST_CLOCK",
    "PERIOD",
    "Execution",
    "FineMotion",
    "JointPath",
    "LapLaw",
    "Law",
    "LawAlongPath",
    "LimitCost",
    "LineLaw",
    "Log",
    "Method",
    "PathLaw",
    "Rates",
    "Samples",
    "Span",
    "Stretch",
    "TaughtData",
    "TimedEvent",
    "Trajectory",
    "check_interval",
    "interval_times",
    "largest_shares",
    "quintic",
    "stand_still",
]
