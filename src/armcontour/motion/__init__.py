"""Joint paths, trajectories, set-points, executions and logs."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "kernels": "interval_times",
    "controller_laws": "CONTROLLERS CommandCurve interpolate_points",
    "derivative_bounds": "largest_shares",
    "cycle": "LONGEST_CLOCK check_cycle",
    "execution": "Execution FineMotion LimitCost SetPoints",
    "set_point_rule": "SetPointRule make_rule",
    "joint_path": "JointPath",
    "laws": "LapLaw Law LawAlongPath PathLaw Rates dwell_law",
    "log": "Log",
    "servoj": "Servoj",
    "trajectory": (
        "DEFAULT_CYCLE LawPhase Method Samples Span TimedEvent TimedWait Trajectory arm_of"
    ),
    "armcontour.core.quintics": "quintic",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
