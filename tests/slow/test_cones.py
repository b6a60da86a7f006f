"""Thirty random jobs whose time the tool axis limits, with a cone of 10 degrees and without.

`python -m tests.slow.test_cones` prints the list.
"""

import numpy as np
from tests.planning.tracing import cone_jobs

CONE = np.radians(10)
JOBS = 30
# A job counts if without its tool axis, in a cone of 60 deg, it takes at least this much less time.
LIMITED = 0.02


def compare_all():
    """Yield seed, durations without and with the cone [s], and the largest angle [rad]."""
    arm = cone_jobs.load_arm()
    found = 0
    seed = 100
    while found < JOBS:
        path = cone_jobs.random_path(seed)
        exact, leaning, angle = cone_jobs.compare(path, arm, CONE)
        freest = cone_jobs.compare(path, arm, np.radians(60))[1]
        if freest < (1 - LIMITED) * exact:
            found += 1
            yield seed, exact, leaning, angle
        seed += 1


def test_a_cone_of_10_degrees_saves_a_tenth_of_the_time():
    ratios = []
    for _, exact, leaning, angle in compare_all():
        assert angle <= CONE * (1 + 1e-9)
        assert leaning <= exact * (1 + 1e-6)
        ratios.append(leaning / exact)
    assert np.median(ratios) < 0.9


if __name__ == "__main__":
    print("seed  0 deg [s]  10 deg [s]  ratio  largest angle [deg]")
    ratios = []
    for seed, exact, leaning, angle in compare_all():
        ratios.append(leaning / exact)
        print(
            f"{seed:4d}  {exact:9.3f}  {leaning:10.3f}  {ratios[-1]:5.3f}  {np.degrees(angle):7.3f}"
        )
    print(f"median {np.median(ratios):.3f}, largest {max(ratios):.3f}")
