"""Limits of jerk: the fastest timing whose accelerations are continuous."""

from armcontour.timing.jerk.limiting import Task, limit_jerk
from armcontour.timing.jerk.rows import JerkLimits

__all__ = ["JerkLimits", "Task", "limit_jerk"]
