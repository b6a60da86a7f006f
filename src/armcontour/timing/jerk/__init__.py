"""Limits of jerk: the fastest timing whose accelerations are continuous."""

from armcontour.timing.jerk.limiting import MOST_ITERATIONS, Task, limit_jerk
from armcontour.timing.jerk.rows import JerkLimits

__all__ = ["MOST_ITERATIONS", "JerkLimits", "Task", "limit_jerk"]
