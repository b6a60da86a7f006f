"""Constraints of the optimal planner: one subclass of `Constraint` for each kind of limit."""

from armcontour.planning.constraints.base import Constraint, IntervalEnds, limits_on
from armcontour.planning.constraints.joints import JointMotion, JointTorque
from armcontour.planning.constraints.second_order import SecondOrder
from armcontour.planning.constraints.tool import (
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
