"""Constraints of the optimal planner: one subclass of `Constraint` for each kind of limit."""

from armcontour.planning.constraints.constraint import (
    Constraint,
    IntervalEnds,
    SecondOrder,
    limits_on,
)
from armcontour.planning.constraints.joint_limits import JointMotion, JointTorque
from armcontour.planning.constraints.tool_limits import (
    AngularAcceleration,
    AngularSpeed,
    CentripetalAcceleration,
    RapidSpeed,
    ToolAcceleration,
    ToolMetric,
    ToolSpeed,
)
from armcontour.planning.topp.on_grid import OnGrid

__all__ = [
    "AngularAcceleration",
    "AngularSpeed",
    "CentripetalAcceleration",
    "Constraint",
    "IntervalEnds",
    "JointMotion",
    "JointTorque",
    "OnGrid",
    "RapidSpeed",
    "SecondOrder",
    "ToolAcceleration",
    "ToolMetric",
    "ToolSpeed",
    "limits_on",
]
