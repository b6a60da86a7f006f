"""Ranges of the sliders on the page, by key of the job."""

from __future__ import annotations

from armcontour.core.text import Keys

# Smallest and largest value in SI units. A slider is linear if its range begins at 0, otherwise
# logarithmic. Values outside the range extend it.
SLIDER_RANGES: dict[Keys, tuple[float, float]] = {
    ("limits", "joint_acceleration"): (1e-2, 100.0),
    ("limits", "joint_velocity"): (1e-2, 10.0),
    ("limits", "joint_jerk"): (1.0, 1e4),
    ("limits", "speed"): (1e-3, 2.0),
    ("limits", "tool_acceleration"): (1e-2, 50.0),
    ("limits", "centripetal_acceleration"): (1e-2, 20.0),
    ("corners", "tolerance"): (1e-5, 2e-2),
    ("cycle",): (1e-4, 2e-2),
    ("servo", "kp"): (1.0, 500.0),
    ("servo", "kv"): (1.0, 2e3),
    ("servo", "ki"): (0.1, 2e2),
    ("timing", "reserve"): (0.0, 0.9),
}
