"""Constraints of the optimal planner: one subclass of `Constraint` for each kind of limit."""

from armcontour.timing.constraints.base import Constraint, IntervalEnds, limits_on
from armcontour.timing.constraints.joints import JointMotion, JointTorque
from armcontour.timing.constraints.second_order import SecondOrder
from armcontour.timing.constraints.tool import (
    AngularAcceleration,
    AngularSpeed,
    CentripetalAcceleration,
    RapidSpeed,
    ToolAcceleration,
    ToolMetric,
    ToolSpeed,
)
from armcontour.timing.topp.on_grid import OnGrid

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
