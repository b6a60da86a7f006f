"""What is judged apart from the planner: all limits, and distances from the cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armcontour.core.errors import Collision
from armcontour.studio.tasks.request import Request
from armcontour.studio.wire import Frame

# Clearance is measured at so many times, and so many of the nearest pairs are told.
CLEARANCE_TIMES, MOST_PAIRS = 400, 10


def check(x: Request) -> Frame:
    """The plan checked against all limits, by code that shares nothing with the planner."""
    from armcontour.core.render import number
    from armcontour.verification import check

    plan = x.set_points
    found = check(plan.trajectory, x.job.arm, plan.run.limits, plan.path)
    worst = found.worst
    most = ""
    if worst is not None:
        most = f" {_words(worst.name)} is used most: {number(worst.ratio, '1')}."
    rows = [
        (
            _words(y.name) + ("" if y.joint is None else f", joint {y.joint + 1}"),
            *(number(y.ratio, "1"), number(y.value, y.unit)),
            number(y.limit, y.unit) if np.isfinite(y.limit) else "none",
            *(number(y.t, "s"), y.verdict),
        )
        for y in found.uses
    ]
    verdict = {"kept": "All limits are kept.", "violated": "A limit is exceeded."}
    sentence = verdict.get(found.verdict, "It cannot be told whether all limits are kept.") + most
    return Frame(
        "result",
        {
            **{"run": plan.run.name, "verdict": found.verdict, "sentence": sentence},
            **{"table": [("Limit", "Used", "Value", "Allowed", "At", "Verdict"), *rows]},
            **{"states": found.states, "not_judged": [_words(y) for y in found.not_judged]},
        },
    )


def _words(name: str) -> str:
    """The name of a limit in words, such as "joint torque"."""
    return name.replace("_", " ")


def clearance(x: Request) -> Frame:
    """How far the arm stays from itself and its cell over time, and the pair that is nearest."""
    from armcontour.core.render import cells, frame
    from armcontour.jobs import run
    from armcontour.studio.view import short

    cell = x.job.cell
    try:
        plan = x.set_points
    except Collision:
        # Where it comes too near is what is asked for.
        job = replace(x.job, ignore_collisions=True)
        (plan,) = run(job, simulate=False, progress=x.progress).runs.values()
    found = cell.check(plan.trajectory)
    t = np.linspace(0.0, plan.trajectory.duration, CLEARANCE_TIMES)
    over_time = cell.smallest_distances(plan.trajectory(t))
    data = found.to_data()
    pairs = data.tables[0]
    header = {
        **{"run": plan.run.name, "sentence": found.sentence, "kept": found.satisfied},
        "rows": frame(data),
        "warnings": [] if found.below_base is None else [found.below_base],
        "kinds": list(over_time),
        "table": cells(replace(pairs, rows=pairs.rows[:MOST_PAIRS])),
        "left_out": len(found.left_out),
    }
    over_time["t"] = t
    return Frame("result", header, {name: short(y) for name, y in over_time.items()})
