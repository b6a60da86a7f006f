"""Tasks that compute figures of a run: results, advice, comparison, limit check, clearance."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.errors import ArmContourError, Collision, InvalidInput
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from armcontour.core.checks import FloatArray
    from armcontour.jobs import RunResult
    from armcontour.jobs.improvements import Advice


# Maximum number of segments of a job for which the Studio computes advice. Advice requires many
# plans of the job.
MAX_SEGMENTS = 200
LONG_NOTE = (
    "The Studio computes no proposals for this program, because it is long. Use the command "
    "armcontour run with --changes."
)
# Generator that computes the advice for the last figures, by text and run.
_advising: dict[tuple[str, str | None], Generator[float, None, Advice]] = {}

# Number of points of each compared curve.
POINTS = 2_000

# Number of times at which clearance is computed, and maximum number of pairs in the table.
CLEARANCE_TIMES, MAX_PAIRS = 400, 10


def figures(request: Request) -> PageFrame:
    """Frame with the exact figures of a run, or a refusal with the position of the error."""
    from armcontour.core.render import frame
    from armcontour.jobs.advice import advice_steps, is_small
    from armcontour.jobs.job_result import judging_rows
    from armcontour.studio.picture import refusal_header, time_header
    from armcontour.studio.preview import Tier

    try:
        result = request.result
    except ArmContourError as error:
        try:
            refusal = refusal_header(error, request.view, tier=3, run=request.run or "")
        except InvalidInput:
            # The data are not a valid job, so there is no picture in which to mark a position.
            refusal = {"tier": 3, "run": request.run, "sentence": str(error), "at": {}}
        return PageFrame("refusal", refusal)
    data = result.to_data()
    header = {
        "run": result.run.name,
        "tier": Tier.EXACT,
        "rows": frame(replace(data, rows=judging_rows(result, data.rows))),
        **time_header(result.explanation),
        "start": result.trajectory(0.0),
        "warnings": data.warnings,
        "notes": [*data.notes, *request.job.arm.notes],
    }
    _advising.clear()
    if is_small(request.job, MAX_SEGMENTS):
        _advising[request.text, request.run] = advice_steps(request.job, result)
    return PageFrame("figures", header)


def changes(request: Request) -> PageFrame:
    """Compute the next step of the advice; the frame of the last step has the proposed changes."""
    from armcontour.jobs.advice import advice_steps, is_small

    if not is_small(request.job, MAX_SEGMENTS):
        return PageFrame(
            "changes", {"run": request.run, "share": 1.0, "changes": [], "note": LONG_NOTE}
        )
    steps = _advising.get((request.text, request.run)) or advice_steps(request.job, request.result)
    _advising[request.text, request.run] = steps
    try:
        return PageFrame("changes", {"run": request.run, "share": next(steps)})
    except StopIteration as end:
        advice: Advice = end.value
    proposals = [
        {
            **{"label": y.label, "effect": y.effect, "edits": [_set(*z) for z in y.edits]},
            "condition": y.condition and f"if {y.condition}",
        }
        for y in advice.improvements
    ]
    return PageFrame(
        "changes", {"run": request.run, "share": 1.0, "changes": proposals, "note": advice.note}
    )


def _set(key: str, value: Any) -> dict[str, Any]:
    return {"do": "set", "key": key, "value": value}


def compare(request: Request) -> PageFrame:
    """Compare the shown run with another run, or with the same run before the last edit."""
    from armcontour.core.render import cells, number
    from armcontour.jobs.differences import differences
    from armcontour.studio.view import to_float32

    other = request.option("with", "")
    if other:
        names, other_request = (str(request.run), other), replace(request, run=other)
    else:
        names, text = ("now", "before"), request.option("text", "")
        if not text:
            raise InvalidInput(
                "The job has not been edited yet. Edit the job, or choose another run to compare."
            )
        other_request = replace(request, text=text)
    results = request.result, other_request.result
    table = differences(results[0].to_data(), results[1].to_data(), names)
    saved = results[1].trajectory.duration - results[0].trajectory.duration
    words = "shorter" if saved > 0 else "longer"
    subject = f"The motion of {names[0]} is" if other else "The motion is now"
    sentence = f"{subject} {number(abs(saved), 's')} {words} than {names[1]}."
    length = max(y.path.length for y in results)
    duration = max(y.motion.t[-1] for y in results)
    s, t = np.linspace(0, length, POINTS), np.linspace(0, duration, POINTS)
    arrays = {"s": s, "t": t}
    for k, result in enumerate(results):
        arrays[f"speed_{k}"], arrays[f"error_{k}"] = _speed(result, s), _error(result, t)
    header = {"run": request.run, "sentence": sentence, "names": names, "table": cells(table)}
    return PageFrame("result", header, {name: to_float32(y) for name, y in arrays.items()})


def _speed(result: RunResult, s: FloatArray) -> FloatArray:
    """Planned tool speeds at arc lengths [m/s], (n,); NaN beyond the end of the path."""
    within = s <= result.path.length
    speed = np.full(len(s), np.nan)
    speed[within] = result.trajectory.speed_at(s[within])
    return speed


def _error(result: RunResult, t: FloatArray) -> FloatArray:
    """Contour errors at times, interpolated [m], (n,); NaN before the first and after the last."""
    assert result.judged is not None
    e = result.judged.contour_error
    return np.interp(t, e.t, e.values, left=np.nan, right=np.nan)


def check(request: Request) -> PageFrame:
    """Check the plan against all limits with code that is independent of the planner."""
    from armcontour.core.render import number
    from armcontour.verification import check

    plan = request.set_points
    result = check(plan.trajectory, request.job.arm, plan.run.limits, plan.path)
    worst = result.worst
    most_used = ""
    if worst is not None:
        most_used = f" The most used limit is {_words(worst.name)}: {number(worst.ratio, '1')}."
    rows = [
        (
            _words(y.name) + ("" if y.joint is None else f", joint {y.joint + 1}"),
            *(number(y.ratio, "1"), number(y.value, y.unit)),
            number(y.limit, y.unit) if np.isfinite(y.limit) else "none",
            *(number(y.t, "s"), y.verdict),
        )
        for y in result.uses
    ]
    verdict = {"kept": "The plan respects all limits.", "violated": "The plan violates a limit."}
    sentence = verdict.get(
        result.verdict, "The check cannot tell whether the plan respects all limits."
    )
    return PageFrame(
        "result",
        {
            **{"run": plan.run.name, "verdict": result.verdict, "sentence": sentence + most_used},
            **{"table": [("Limit", "Used", "Value", "Allowed", "At", "Verdict"), *rows]},
            **{"states": result.states, "not_judged": [_words(y) for y in result.not_judged]},
        },
    )


def _words(name: str) -> str:
    return name.replace("_", " ")


def clearance(request: Request) -> PageFrame:
    """Compute distances of the arm from itself and its cell over time, and the nearest pairs."""
    from armcontour.core.render import cells, frame
    from armcontour.jobs import run
    from armcontour.studio.view import to_float32

    cell = request.job.cell
    try:
        plan = request.set_points
    except Collision:
        # The distances are also computed if the motion collides.
        job = replace(request.job, ignore_collisions=True)
        (plan,) = run(job, simulate=False, progress=request.progress).runs.values()
    result = cell.check(plan.trajectory)
    t = np.linspace(0.0, plan.trajectory.duration, CLEARANCE_TIMES)
    over_time = cell.smallest_distances(plan.trajectory(t))
    data = result.to_data()
    pairs = data.tables[0]
    header = {
        **{"run": plan.run.name, "sentence": result.sentence, "kept": result.satisfied},
        "rows": frame(data),
        "warnings": [] if result.below_base is None else [result.below_base],
        "kinds": list(over_time),
        "table": cells(replace(pairs, rows=pairs.rows[:MAX_PAIRS])),
        "left_out": len(result.left_out),
    }
    over_time["t"] = t
    return PageFrame("result", header, {name: to_float32(y) for name, y in over_time.items()})
