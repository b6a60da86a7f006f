"""Constraints of the optimal planner: one subclass of `Constraint` for each kind of limit."""

from armcontour.timing.constraints.angular import (
    AngularAcceleration,
    AngularSpeed,
    turning_of,
)
from armcontour.timing.constraints.base import (
    Bounds,
    Ceiling,
    Constraint,
    Disc,
    IntervalEnds,
    JointDerivatives,
    Rows,
)
from armcontour.timing.constraints.jerk import jerks_of
from armcontour.timing.constraints.joint_acceleration import JointAcceleration
from armcontour.timing.constraints.joint_torque import JointTorque
from armcontour.timing.constraints.joint_velocity import JointVelocity
from armcontour.timing.constraints.second_order import SecondOrder
from armcontour.timing.constraints.tool import (
    CentripetalAcceleration,
    ToolAcceleration,
    ToolMetric,
    ToolSpeed,
)

__all__ = [
    "AngularAcceleration",
    "AngularSpeed",
    "Bounds",
    "Ceiling",
    "CentripetalAcceleration",
    "Constraint",
    "Disc",
    "IntervalEnds",
    "JointAcceleration",
    "JointDerivatives",
    "JointTorque",
    "JointVelocity",
    "Rows",
    "SecondOrder",
    "ToolAcceleration",
    "ToolMetric",
    "ToolSpeed",
    "jerks_of",
    "turning_of",
]
