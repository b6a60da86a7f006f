"""Plan one joint along random paths that reverse, and compare with the closed form."""

from __future__ import annotations

from tests.oracle.one_joint import draw, limits_of, shortest_time

import armcontour as ac
from soak import Outcome

# Share of the shortest time by which a plan may be longer, and rounding error of both.
LONGEST = 1e-3
ROUNDING = 1e-9
# Five of eight paths have very uneven pieces.
ROUGH_OF_EIGHT = 5


def run(seed: int) -> Outcome:
    """Plan a path of one joint, and compare the duration with the shortest time."""
    rough = seed % 8 < ROUGH_OF_EIGHT
    path, velocity, acceleration = draw(seed, rough=rough)
    planned = ac.plan(path, limits=limits_of(velocity, acceleration))
    loss = planned.duration / shortest_time(path, velocity, acceleration) - 1
    kind = "rough" if rough else "smooth"
    within = -ROUNDING <= loss <= LONGEST
    notes = [] if within else [f"the plan differs by {loss:+.3%} from the shortest time"]
    return Outcome(kind=kind, result="planned", notes=notes)
