"""Limits of jerk: the fastest timing whose accelerations are continuous."""

from armcontour.timing.jerk.limiting import limit_jerk
from armcontour.timing.jerk.rows import JerkLimits
from armcontour.timing.jerk.sections import MOST_ITERATIONS, Task

__all__ = ["MOST_ITERATIONS", "JerkLimits", "Task", "limit_jerk"]
