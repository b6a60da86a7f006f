"""Motions as values: joint paths, trajectories, taught data, executions."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
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
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "_intervals": "interval_times",
            "bounding": "largest_shares",
            "execution": "LONGEST_CLOCK Execution FineMotion LimitCost TaughtData check_interval",
            "joint_path": "JointPath",
            "laws": "LapLaw Law LawAlongPath LineLaw PathLaw Rates stand_still",
            "log": "Log",
            "trajectory": "PERIOD Method Samples Span Stretch TimedEvent Trajectory",
            "armcontour._quintics": "quintic",
        },
    )
