"""Constraints of the optimal planner: one subclass of `Constraint` for each kind of limit."""

from armcontour.planning.constraints.constraint import (
    CONSTRAINTS,
    Constraint,
    IntervalEnds,
    JointMotion,
    JointTorque,
    SecondOrder,
    limits_on,
)
from armcontour.planning.constraints.tool_limits import (
    RapidSpeed,
    ToolConstraint,
    assigned_speeds,
)
from armcontour.planning.topp.on_grid import OnGrid

__all__ = [
    "CONSTRAINTS",
    "Constraint",
    "IntervalEnds",
    "JointMotion",
    "JointTorque",
    "OnGrid",
    "RapidSpeed",
    "SecondOrder",
    "ToolConstraint",
    "assigned_speeds",
    "limits_on",
]
