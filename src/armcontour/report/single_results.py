"""Conversion of single results (plan, execution, evaluation, run) to job results for reports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armcontour.control.compensation import Inverse
from armcontour.core.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.jobs import Job, JobResult, Run, RunResult
from armcontour.jobs.methods import COMPENSATIONS, TIMINGS
from armcontour.motion import DEFAULT_CYCLE, Execution, Method, Span, Trajectory, arm_of
from armcontour.planning import Optimal, explain
from armcontour.program import Contour, Dwell, Move, Program, Rapid
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.servo import ServoModel
from armcontour.verification import Evaluation, evaluate

Result = JobResult | RunResult | Evaluation | Execution | Trajectory
# Number of tool-path points drawn for a plan in joint space.
PLACES = 2000


def job_result_of(result: Result) -> JobResult:
    """Make the job result whose only run is a result.

    Raises InvalidInput if the result does not contain its arm, or an evaluation its execution.
    """
    if isinstance(result, JobResult):
        return result
    if isinstance(result, RunResult):
        return _only_run(result)
    if isinstance(result, Trajectory):
        plan = _planned(result)
        return _only_run(replace(plan, set_points=Execution.from_plan(result, plan.arm).set_points))
    if isinstance(result, Execution):
        result = evaluate(result, _planned(result.set_points.trajectory, result.arm).path)
    if result.judged is None:
        raise InvalidInput(
            "A report requires the execution, but this evaluation does not contain its execution. "
            "Evaluate the execution again."
        )
    evaluated = result.judged
    limits = evaluated.limits
    set_points = evaluated.executed.set_points
    plan = _planned(set_points.trajectory, evaluated.executed.arm, evaluated.path, limits)
    servo = getattr(evaluated.executed.plant, "servo", None)
    run_result = replace(
        plan,
        run=_run("run", plan.trajectory, set_points.method, limits, set_points.cycle),
        objective=plan.objective if evaluated.objective is None else evaluated.objective,
        set_points=set_points,
        servo=servo if isinstance(servo, ServoModel) else None,
        execution=evaluated.executed,
        evaluation=result,
    )
    return _only_run(run_result)


def _only_run(result: RunResult) -> JobResult:
    """Make a job result with one run."""
    # A servo of order "unknown" without dead time follows its set-points exactly.
    servo = ServoModel(order="unknown") if result.servo is None else result.servo
    job = Job(
        name=result.run.name,
        title=f"{result.run.name.capitalize()} of {result.arm.name}",
        arm=result.arm,
        path=result.objective,
        servo=servo,
        runs=(result.run,),
    )
    return JobResult(job=job, runs={result.run.name: result})


def _planned(
    plan: Trajectory,
    arm: Arm | None = None,
    program: Program | None = None,
    limits: Limits | None = None,
) -> RunResult:
    """Make the planned run of a trajectory; its own arm, program and limits are the defaults."""
    arm = arm_of(plan, arm)
    program = _program_of(plan, arm) if program is None else program
    limits = resolve_limits("write_report", arm, limits, plan.limits)
    # An explanation requires the limits of the plan; without them, no limit would be active.
    explained = plan.limits is not None and plan.method == Method.OPTIMAL
    explanation = explain(plan, arm) if explained else None
    sharp = getattr(program.single_path, "objective", None)
    return RunResult(
        run=_run("plan", plan, "none", limits, DEFAULT_CYCLE),
        objective=program if sharp is None else Program.from_path(sharp),
        path=program,
        trajectory=plan,
        explanation=explanation,
    )


def _run(name: str, plan: Trajectory, method: str, limits: Limits, cycle: float) -> Run:
    """Return a run that describes a plan without a job.

    - `method`: name of the compensation.
    - `cycle`: cycle of the set-points [s].
    """
    return Run(
        name=name,
        timing=TIMINGS.get(plan.method, Optimal)(),
        compensation=COMPENSATIONS.get(method, Inverse)(),
        limits=limits,
        cycle=cycle,
    )


def _program_of(plan: Trajectory, arm: Arm) -> Program:
    """Make the program of a plan; for a plan in joint space, its tool path as a polyline."""
    if plan.spans:
        return Program(tuple(_move_of(x) for x in plan.spans if x.move is not None))
    if plan.path is not None:
        return Program.from_path(plan.path)
    tool = arm.tool_position(plan(np.linspace(0, plan.duration, PLACES)))
    return Program.from_path(Path.polyline(tool))


def _move_of(span: Span) -> Move:
    """Make the program's move that corresponds to a span of a plan."""
    if span.kind == "dwell":
        return Dwell(span.t[1] - span.t[0])
    motion = span.trajectory
    if span.kind == "rapid" or motion is None or motion.path is None:
        return Rapid()
    work = None
    if span.work is not None:
        start, end = motion.s(np.array(span.work) - span.t[0]).tolist()
        work = start, end
    return Contour(motion.path, name=span.name, work=work)
