"""Motions as values: joint paths, trajectories, taught data, executions."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "_intervals": "interval_times",
    "bounding": "largest_shares",
    "execution": "LONGEST_CLOCK Execution FineMotion LimitCost TaughtData check_interval",
    "joint_path": "JointPath",
    "laws": "LapLaw Law LawAlongPath LineLaw PathLaw Rates stand_still",
    "log": "Log",
    "trajectory": "PERIOD Method Samples Span Stretch TimedEvent Trajectory",
    "armcontour.core._quintics": "quintic",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
