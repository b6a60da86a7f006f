"""Jobs of programs: leads, warnings, and full stops where jerk is limited."""

import dataclasses
from pathlib import Path as FilePath

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics
from tests.geometry.tables import arc, line, path_of, refused
from tests.jobs.making import ARM, a_job, a_run

import armcontour as ac
from armcontour.core.errors import Unreachable
from armcontour.core.progress import Step
from armcontour.files.job_file import read_cell
from armcontour.geometry import Arc, Path
from armcontour.jobs import Rounding, run, warnings_of
from armcontour.jobs.run_plan import plan_one, prepare_program
from armcontour.program import Contour, Event, Lead, Pierce, Process, Program, Switch

LIMITS = ARM.limits.replace(speed=0.05, centripetal_acceleration=0.09)
SQUARE = Path.polyline([[0.28, 0.1], [0.36, 0.1], [0.36, 0.16], [0.28, 0.16], [0.28, 0.1]])
BEND = Path.polyline([[0.3, 0.2], [0.35, 0.2], [0.35, 0.25]])
TWO = (Contour(path=SQUARE, name="square"), Contour(path=BEND))


def job(process, *moves, arm=ARM, **values):
    timing = ac.Optimal(reserve=0.1)
    run_options = {
        "limits": LIMITS,
        "rounding": Rounding(tolerance=1e-3),
        "timing": timing,
        **values,
    }
    program = Program(moves=moves or TWO)
    return a_job(program, a_run("compensated", **run_options), arm=arm, process=process)


def planned(done):
    """The program of a job's run, its plan, and its speeds at the ends of the work."""
    (job_run,) = done.runs
    plan = plan_one(done, job_run, clear=False)
    errors = []
    program = plan.path
    trajectory = plan.trajectory
    for span in trajectory.spans:
        if span.work is not None:
            t = np.array(span.work)
            errors.append(
                np.linalg.norm(ARM.tool_velocity(trajectory(t), trajectory(t, 1)), axis=1)
            )
    assert len(errors) == len(program.contours)
    return program, trajectory, errors


def after(contour):
    """Length of the lead-out."""
    return contour.path.length - contour.at_work[1]


@pytest.mark.parametrize("approach", [0.0, 5e-3])
def test_tool_pierces_at_the_start_of_its_contour(approach):
    arm = ARM if not approach else ac.load_arm("ur5e")
    height = np.array([0.0, 0.0, 0.0]) if arm is ARM else np.array([0.05, 0.0, 0.2])
    contours = [Contour(path=Path.polyline([(x, 0.2), (x, 0.23)])) for x in (0.30, 0.34, 0.38)]
    if arm is not ARM:
        lines = (x.path.vertices for x in contours)
        lifted = (np.column_stack([x, np.zeros(2)]) + height for x in lines)
        contours = [Contour(path=Path.polyline(x).pointing((0, 0, -1))) for x in lifted]
    pierced = Process(switch=Switch("torch"), pierce=Pierce(0.3), dwell=0.1, approach=approach)
    case = job(pierced, *contours, arm=arm, limits=LIMITS if arm is ARM else arm.limits)
    plan = plan_one(case, case.runs[0], clear=False)
    trajectory = plan.trajectory
    on = [x for x in trajectory.events if x.value]
    assert len(on) == 3
    for event, span, contour in zip(on, trajectory.contour_spans, contours, strict=True):
        assert span.t[0] - event.t == pytest.approx(0.3, abs=1e-9)
        # The tool rests at the start from before the switch until the contour begins.
        t = np.linspace(span.t[0] - 0.4, span.t[0], 20)
        tool = arm.tool_position(trajectory(t))
        np.testing.assert_allclose(tool, np.tile(contour.path(0.0), (20, 1)), atol=1e-6)


def test_automatic_leads_follow_the_settings_of_layers_and_the_new_order():
    moves = [
        dataclasses.replace(x, layer=layer) for x, layer in zip(TWO, ("CUT", "MARK"), strict=True)
    ]
    line = Lead(length=3e-3)
    process = Process(lead_in=Lead(), by_layer={"MARK": {"lead_in": line, "lead_out": Lead()}})
    alone = [job(Process(lead_in=Lead()), moves[0]), job(Process(lead_out=Lead()), moves[1])]
    (cut,), (mark,) = (prepare_program(x, x.runs[0]).contours for x in alone)
    case = job(process, *moves)
    first, second = prepare_program(case, case.runs[0]).contours
    assert first.work == pytest.approx(cut.at_work, rel=1e-6) and cut.at_work[0] > 1e-3
    assert second.work[0] == pytest.approx(3e-3, abs=1e-12)
    assert after(second) == pytest.approx(after(mark), rel=1e-6) and after(mark) > 1e-3
    hole = Path(segments=[Arc.circle((0.33, 0.13), (0.32, 0.13))])
    contours = [Contour(path=SQUARE, name="outline"), Contour(path=hole, name="hole")]
    lengths = []
    for moves in (contours, contours[::-1]):
        case = job(Process(lead_in=Lead(shape="arc")), *moves)
        objective = prepare_program(case, case.runs[0])
        assert [x.name for x in objective.contours] == ["hole", "outline"]
        lengths.append([x.at_work[0] for x in objective.contours])
    assert (
        lengths[0] == pytest.approx(lengths[1], rel=1e-6)
        and abs(lengths[0][0] - lengths[0][1]) > 1e-4
    )


@pytest.mark.parametrize("shape", ["line", "arc"])
def test_automatic_leads_have_the_length_for_the_assigned_velocity(shape):
    lead = Lead(shape=shape)
    case = job(Process(lead_in=lead, lead_out=lead))
    program, trajectory, speeds = planned(case)
    np.testing.assert_allclose(speeds, 0.05, rtol=1e-3)
    assert run(case).runs["compensated"].warnings == ()
    # Three quarters are too short, so leads are not much longer than the tool needs.
    for i, contour in enumerate(program.contours):
        lengths = 0.75 * contour.work[0], 0.75 * after(contour)
        ends = (Lead(shape=shape, length=x) for x in lengths)
        shorter = Process(**dict(zip(("lead_in", "lead_out"), ends, strict=True)))
        assert (planned(dataclasses.replace(case, process=shorter))[2][i] < 0.05 * (1 - 1e-4)).all()


def test_automatic_leads_stay_within_reach_and_specified_lengths_stay():
    # Outward, to 10 mm before the end of what the arm reaches, 0.465 m from its base at 0.135 m.
    path = Path.polyline([[0.4, 0.0], [0.59, 0.0]])
    case = job(Process(lead_in=Lead(), lead_out=Lead()), Contour(path=path, name="ray"))
    program, _, ((on, work_end),) = planned(case)
    assert 0 < after(program.contours[0]) < 0.01
    assert on == pytest.approx(0.05, rel=1e-3) and 0 < work_end <= 0.05 * (1 + 1e-9)
    explicit = job(Process(lead_in=Lead(), lead_out=Lead(length=0.003)), Contour(path=BEND))
    program, _, ((on, work_end),) = planned(explicit)
    assert after(program.contours[0]) == pytest.approx(0.003, abs=1e-12)
    assert on == pytest.approx(0.05, rel=1e-3) and work_end < 0.049


def test_invalid_jobs_are_refused():
    auto = Process(lead_in=Lead())
    far = Contour(path=Path.polyline([[0.5, 0.1], [0.6, 0.1]]), name="E7")
    led = Process(lead_in=Lead(length=0.01))
    refused((lambda: run(job(auto, *TWO, far)), "Contour 3 (E7)", "PMK-3s"), kind=Unreachable)
    refused(
        (lambda: run(job(auto, timing=ac.Paper())), "Run compensated", "optimal", "paper"),
        (lambda: job(Process(), end_time=3.0), "end_time requires a job with a single path"),
        (lambda: run(job(led, Contour(path=BEND), end_time=3.0)), "end_time"),
        (lambda: run(job(Process(resume_at=1.0))), "but is 1 m"),
    )


def test_a_warning_names_leads_that_are_too_short():
    def warnings(path, shape="line", **leads):
        process = Process(**{k: Lead(shape=shape, length=x) for k, x in leads.items()})
        return run(job(process, Contour(path=path))).runs["compensated"].warnings

    (warning,) = warnings(BEND, lead_in=0.001)
    assert "contour 1 begins at" in warning and "with a lead of 1 mm." in warning
    assert warnings(BEND) == ()
    # From 50 mm/s the tool does not stop within 3 mm, however long the lead before them.
    line = Path.polyline([[0.3, 0.2], [0.303, 0.2]])
    (on,) = warnings(line, lead_in=0.03)
    assert "contour 1 begins at" in on
    (too_long,) = warnings(line, lead_out=0.03)
    assert "contour 1 ends at" in too_long
    assert warnings(line, lead_in=0.03, lead_out=0.03) == ()
    # An arc of a lead may be too tight for the velocity, and a longer one is not.
    (tight,) = warnings(SQUARE, "arc", lead_in=0.02)
    assert "with a lead of 20 mm" in tight
    assert warnings(SQUARE, "arc", lead_in=0.06) == ()


def test_a_drawing_is_run_up_to_its_evaluation():
    progress_log = []
    lead = Lead(length=0.01)
    process = Process(lead_in=lead, lead_out=lead, switch=Switch(), events=(Event(name="x"),))
    result = run(job(process), progress=progress_log.append).runs["compensated"]
    assert isinstance(result.path, Program) and isinstance(result.objective, Program)
    by_contour = [x for x in progress_log if x.done is not None]
    for name in ("tracing", "timing", "evaluation"):
        of_step = [x for x in by_contour if x.names == ("compensated", name)]
        # Automatic leads are found before, so tracing and timing may be reported twice.
        assert of_step[-2:] == [
            Step(("compensated", name), 0.5, "contour 1 of 2"),
            Step(("compensated", name), 1.0, "contour 2 of 2"),
        ]
    steps = "rounding tracing timing clearance compensation execution evaluation clearance"
    assert [x.names[-1] for x in progress_log if x.done is None] == steps.split()
    assert result.evaluation.contour_error.max < 2e-5
    assert len(result.evaluation.contours) == 2
    names = [x.name for x in result.trajectory.events]
    assert names in (["x", "tool", "tool"] * 2, ["tool", "x", "tool"] * 2)
    assert result.explanation is not None and result.path.single_path is None
    assert result.set_points.trajectory is result.trajectory


def test_runs_share_equal_plans_and_have_their_own_automatic_leads():
    one = job(Process(lead_in=Lead(length=0.01)))
    (first_run,) = one.runs
    plain = dataclasses.replace(first_run, name="plain", compensation=ac.NoCompensation())
    slower = dataclasses.replace(first_run, name="slow", limits=LIMITS.replace(speed=0.02))
    runs = run(dataclasses.replace(one, runs=(first_run, plain, slower))).runs
    shared = runs["compensated"].trajectory
    assert runs["plain"].trajectory is shared is not runs["slow"].trajectory
    assert runs["plain"].run.name == "plain"
    auto = job(Process(lead_in=Lead()), Contour(path=BEND), rounding=None)
    (first_run,) = auto.runs
    less = dataclasses.replace(first_run, name="less", timing=ac.Optimal(reserve=0.5))
    runs = ac.jobs.run(dataclasses.replace(auto, runs=(first_run, less)), simulate=False).runs
    assert runs["less"].path.contours[0].work[0] > runs["compensated"].path.contours[0].work[0]


DRAWINGS = FilePath(__file__).parents[2] / "examples" / "drawings"
# A line, a quarter of a circle, and a line: the curvature jumps at both ends of the arc.
BENT = path_of(
    line((0.30, 0.20), (0.36, 0.20)),
    arc((0.36, 0.20), (0.36, 0.22), np.pi / 2),
    line((0.38, 0.22), (0.38, 0.26)),
)
ENDS = [0.06, 0.06 + 0.01 * np.pi]
ARCS = Rounding(tolerance=1e-3, continuity="tangent")


def plans(path, *runs, arm=ARM):
    run_options = {
        "compensation": ac.NoCompensation(),
        "limits": arm.limits.replace(speed=0.1, joint_jerk=7.2).for_joints(arm.dof),
        "rounding": Rounding(tolerance=1e-3),
        "timing": ac.Optimal(intervals=200),
    }
    made = (a_run(f"run{i}", **run_options | x) for i, x in enumerate(runs))
    return list(run(a_job(path, *made, arm=arm), simulate=False).runs.values())


def stops_said(sentences):
    return [x for x in sentences if "full stop" in x]


def test_stops_at_ends_of_arcs_are_reported_once_and_counted_by_contour():
    runs = ({}, {"compensation": ac.Inverse()}, {"compensation": ac.NoCompensation()})
    results = plans(BENT, *({**x, "rounding": None} for x in runs))
    for plan in results:
        assert [x.s for x in plan.jerk_stops] == pytest.approx(ENDS, abs=1e-12)
        assert plan.jerk_stops[1].point == pytest.approx((0.38, 0.22), abs=1e-9)
        assert plan.trajectory.speed_at(ENDS) == pytest.approx([0, 0], abs=1e-9)
        assert plan.full_stops == {"curvature jumps": 2}
        assert stops_said(plan.remarks) == []
    (warning,) = stops_said(warnings_of(results))
    assert warning.startswith(
        "Runs run0, run1, run2: 2 full stops, the first at s = 60 mm (360 mm, 200"
    )
    straight = ac.Path.polyline([(0.3, 0.3), (0.34, 0.3)])
    program = Program(moves=(Contour(path=straight, name="A"), Contour(path=BENT, name="B")))
    (plan,) = plans(program, {"rounding": None})
    assert [x.contour for x in plan.jerk_stops] == ["contour 2 (B)"] * 2
    (warning,) = stops_said(plan.warnings)
    assert "2 full stops, the first at s = 60 mm (360 mm, 200 mm) of contour 2 (B)" in warning


def test_transitions_within_the_tolerance_avoid_stops():
    coarse = Rounding(tolerance=2e-6)
    results = plans(BENT, {}, {"rounding": coarse}, {"rounding": ARCS})
    times = {}
    for plan, allowed in zip(results, (1e-5, 2e-6, 0.0), strict=True):
        path = plan.path.path
        deviation = BENT.project(path(np.linspace(0.0, path.length, 4001))).distance.max()
        assert deviation <= allowed + 1e-12 and (deviation > 0.5 * allowed or allowed == 0.0)
        assert plan.full_stops == ({} if allowed else {"curvature jumps": 2})
        times[allowed] = plan.trajectory.duration
    assert sorted(times, reverse=True) == sorted(times, key=lambda x: times[x])


@needs_dynamics
def test_set_points_of_a_drawing_stay_within_the_joint_velocities():
    """An ellipse of 37 arcs on the UR5e, with acceleration and jerk of a joint_limits.yaml."""
    one = {
        ("path", "names"): ["CUT-6"],
        ("cycle",): "4 ms",
        ("runs", "as-planned", "cycle"): "2 ms",
    }
    drawn = read_cell(DRAWINGS / "gentle.yaml", DRAWINGS / "gasket.dxf", patch=one)
    as_planned, compensated = run(drawn, simulate=False).runs.values()
    assert as_planned.full_stops == {} and as_planned.warnings == ()
    limits = drawn.runs[0].limits
    set_points = as_planned.set_points
    bounds = limits.joint_velocity, limits.joint_acceleration, limits.joint_jerk
    for order, limit in enumerate(bounds, 1):
        ratio = np.abs(np.diff(set_points.q, order, axis=0)) / set_points.cycle**order / limit
        assert ratio.max() < 1 + 1e-6
    assert ratio.max() > 0.99
    # The inverse of the servo leads by dddq / K_p, and by what the jerk's own jumps ask for.
    set_points = compensated.set_points
    ahead = np.abs(np.diff(set_points.q, 2, axis=0)) / set_points.cycle**2
    assert (ahead < limits.joint_acceleration + limits.joint_jerk / 25.0).all()
