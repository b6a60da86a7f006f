"""Plan joint paths through very many points, and measure the memory."""

from __future__ import annotations

import resource
import sys

import numpy as np

import armcontour as ac
from soak import Outcome

COUNTS = (45_000, 60_000, 200_000)
KINDS = ("walk", "sines", "noisy sines")
# Largest memory of the process [kB]; other units on macOS are not judged.
LARGEST_MEMORY = 1_200_000
SAMPLES = 20_001
LEAK = 1e-9


def run(seed: int) -> Outcome:
    """Plan a spline through many points; judge its limits at samples, and the memory."""
    kind = KINDS[seed % 3]
    count = COUNTS[seed // 3 % 3]
    rng = np.random.default_rng(seed)
    if kind == "walk":
        points = np.cumsum(rng.normal(size=(count, 6)), 0) * 0.05
    else:
        t = np.linspace(0, 1, count)[:, None]
        points = np.sin(2 * np.pi * t * np.array([[20, 15, 17, 13, 11, 9]]))
        points += 1e-3 * (kind == "noisy sines") * rng.normal(size=points.shape)
    limits = ac.Limits(joint_velocity=2.0, joint_acceleration=10.0)
    planned = ac.plan(ac.JointPath.spline(points), limits=limits)
    t = np.linspace(0, planned.duration, SAMPLES)
    worst = max(np.abs(planned(t, 1)).max() / 2.0, np.abs(planned(t, 2)).max() / 10.0)
    notes = [] if worst <= 1 + LEAK else [f"a limit is exceeded by {worst - 1:.3g}"]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    if sys.platform == "linux" and memory > LARGEST_MEMORY:
        notes.append(f"the plan takes {memory / 1e6:.2f} GB")
    return Outcome(kind=f"{count} points, {kind}", result="planned", notes=notes, worst=worst)
