"""The cycle of set-points, and its check."""

from __future__ import annotations

from armcontour.core import checks
from armcontour.core.errors import InvalidInput

# Smallest and largest cycle [s]. Shorter cycles approach rounding errors of times; longer cycles do
# not determine the motion between set-points.
INTERVALS = (1e-6, 1.0)
# Longest cycle of a controller [s]; industrial controllers have cycles of 1 to 40 ms.
LONGEST_CLOCK = 0.1


def check_cycle(cycle: float) -> float:
    """Return the cycle [s] if it is within INTERVALS; otherwise raise InvalidInput."""
    interval = checks.check_number("cycle", cycle, "s")
    # Such a number may be in milliseconds.
    if INTERVALS[1] < interval <= 1e3 * INTERVALS[1]:
        raise InvalidInput(
            f"cycle is {interval:g} s, but must be at most {INTERVALS[1]:g} s. A number without a "
            f"unit is in s. For {interval:g} ms, specify {interval:g} ms in a job, or "
            f"{interval / 1e3:g} in Python.",
            needed=interval,
            allowed=INTERVALS[1],
            key=("cycle",),
        )
    return checks.check_range("cycle", interval, *INTERVALS, "s")
