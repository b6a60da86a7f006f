"""Adapters of robot controllers: play set-points, and record commanded and measured positions."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "armcontour.core.errors": "ControllerLost ControllerRefused",
    "controller": "Controller Motion PlayedMotion",
    "franka": "Franka",
    "linuxcnc": "LinuxCNC",
    "player": "Played play",
    "rolling_rows": "Chunk RollingRows",
    "robot_identification": "RobotIdentification identify_on",
    "robot_learning": "RobotLearning learn_on",
    "unfinished": "UnfinishedMotion unfinished_place",
    "ur": "Ur",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
