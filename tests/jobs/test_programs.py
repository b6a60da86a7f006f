"""Jobs of programs: automatic leads, warnings, and all arrows at once."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable

import numpy as np
import pytest

import armcontour as ac
from armcontour._progress import Step
from armcontour.errors import InvalidInput, Unreachable
from armcontour.geometry import Arc, Path
from armcontour.jobs import Job, Rounding, Run, run
from armcontour.jobs.programs import plan_run, programs_of
from armcontour.jobs.slow_ends import slow_ends
from armcontour.motion import Trajectory
from armcontour.program import Contour, Event, Lead, Process, Program, Switch

ARM = ac.load_arm("pmk3s")
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
LIMITS = ARM.limits.replace(speed=0.05, centripetal_acceleration=0.09)
SQUARE = Path.polyline([[0.28, 0.1], [0.36, 0.1], [0.36, 0.16], [0.28, 0.16], [0.28, 0.1]])
BEND = Path.polyline([[0.3, 0.2], [0.35, 0.2], [0.35, 0.25]])
TWO = (Contour(path=SQUARE, name="square"), Contour(path=BEND))


def job(process: Process, *moves: Contour, **values: object) -> Job:
    asked = {
        "name": "taught",
        "timing": "optimal",
        "compensation": "inverse",
        "limits": LIMITS,
        "rounding": Rounding(tolerance=1e-3),
        "period": 4e-3,
        "reserve": 0.1,
        **values,
    }
    return Job(
        name="j",
        title="j",
        arm=ARM,
        path=Program(moves=moves or TWO),
        servo=SERVO,
        plant_servo=SERVO,
        process=process,
        runs=(Run(**asked),),  # type: ignore[arg-type]
    )


def speeds_at_ends(program: Program, trajectory: Trajectory) -> list[tuple[float, float]]:
    """Speeds of the tool where every contour begins and ends, by the joints."""
    found = []
    for span in trajectory.spans:
        if span.work is not None:
            t = np.array(span.work)
            speed = np.linalg.norm(ARM.tool_velocity(trajectory(t), trajectory(t, 1)), axis=1)
            found.append((float(speed[0]), float(speed[1])))
    assert len(found) == len(program.contours)
    return found


def test_automatic_leads_are_those_of_the_layers() -> None:
    moves = [dataclasses.replace(x, layer=of) for x, of in zip(TWO, ("CUT", "MARK"), strict=True)]
    line = Lead(length=3e-3)
    process = Process(lead_in=Lead(), by_layer={"MARK": {"lead_in": line, "lead_out": Lead()}})
    alone = [job(Process(lead_in=Lead()), moves[0]), job(Process(lead_out=Lead()), moves[1])]
    (cut, _), (_, mark) = (programs_of(x, x.runs[0])[0].contours * 2 for x in alone)
    done = job(process, *moves)
    first, second = programs_of(done, done.runs[0])[0].contours
    assert first.work == pytest.approx(cut.at_work, abs=1e-12) and cut.at_work[0] > 1e-3
    assert second.work is not None and second.work[0] == pytest.approx(3e-3, abs=1e-12)
    after = second.path.length - second.work[1]
    assert after == pytest.approx(mark.path.length - mark.at_work[1], abs=1e-12) and after > 1e-3


def test_automatic_leads_are_those_of_the_contours_in_their_new_order() -> None:
    hole = Path.from_segments([Arc.circle((0.33, 0.13), (0.32, 0.13))])
    contours = [Contour(path=SQUARE, name="outline"), Contour(path=hole, name="hole")]
    lengths = []
    for moves in (contours, contours[::-1]):
        done = job(Process(lead_in=Lead(shape="arc")), *moves)
        objective, _ = programs_of(done, done.runs[0])
        assert [x.name for x in objective.contours] == ["hole", "outline"]
        lengths.append([x.at_work[0] for x in objective.contours])
    assert lengths[0] == lengths[1] and abs(lengths[0][0] - lengths[0][1]) > 1e-4


@pytest.mark.parametrize("shape", ["line", "arc"])
def test_automatic_leads_are_as_long_as_the_assigned_velocity_needs(shape: str) -> None:
    lead = Lead(shape=shape)
    done = job(Process(lead_in=lead, lead_out=lead))
    (this,) = done.runs
    _, program = programs_of(done, this)
    trajectory = plan_run(done, this, program)
    for on, off in speeds_at_ends(program, trajectory):
        assert on == pytest.approx(0.05, rel=1e-3)
        assert off == pytest.approx(0.05, rel=1e-3)
    assert slow_ends(program, trajectory, this) == []
    # A tenth less does not do: they are not longer than they need.
    for i, contour in enumerate(program.contours):
        assert contour.work is not None
        before, after = contour.work[0], contour.path.length - contour.work[1]
        shorter = dataclasses.replace(
            done,
            process=Process(
                lead_in=Lead(shape=shape, length=0.9 * before),
                lead_out=Lead(shape=shape, length=0.9 * after),
            ),
        )
        _, other = programs_of(shorter, this)
        on, off = speeds_at_ends(other, plan_run(shorter, this, other))[i]
        assert on < 0.05 * (1 - 1e-4) and off < 0.05 * (1 - 1e-4)


def test_automatic_leads_reach_an_assigned_velocity_that_is_little_more_than_half_of_them_reach():
    # Under a limit of jerk, the last doubling gives less than it must give where it falls short.
    limits = LIMITS.replace(speed=0.025, path_jerk=0.5)
    half, done = (
        job(Process(lead_in=Lead(length=length)), Contour(path=BEND), limits=limits)
        for length in (0.004, None)
    )
    _, program = programs_of(half, half.runs[0])
    ((on, _),) = speeds_at_ends(program, plan_run(half, half.runs[0], program))
    assert 0.025 / 1.05 < on < 0.025 * (1 - 1e-3)
    _, program = programs_of(done, done.runs[0])
    ((on, _),) = speeds_at_ends(program, plan_run(done, done.runs[0], program))
    assert on == pytest.approx(0.025, rel=1e-3)


def test_automatic_leads_of_a_pierced_contour_are_found_without_the_way_down() -> None:
    line = Path.polyline([(0.40, 0.15, 0.1), (0.46, 0.15, 0.1)]).pointing([0, 0, -1])
    arm, height = ac.load_arm("ur5e"), 2e-3
    pierce = ac.Pierce(time=0.2, height=height)
    lead = Lead(shape="arc", side="left", active=True)
    lengths = []
    for given in ({}, {"pierce": pierce, "switch": Switch(name="laser")}):
        done = dataclasses.replace(
            job(
                Process(lead_in=lead, **given),  # type: ignore[arg-type]
                Contour(path=line),
                limits=arm.limits.replace(speed=0.05),
            ),
            arm=arm,
        )
        _, program = programs_of(done, done.runs[0])
        lengths.append(program.contours[0].at_work[0])
    assert lengths[1] == pytest.approx(lengths[0] + height) and lengths[0] > 0


def test_automatic_leads_stop_growing_where_the_speed_does() -> None:
    # A small circle: centripetal acceleration holds the tool below the assigned velocity.
    circle = Path.from_segments([Arc(start=[0.32, 0.2], center=[0.31, 0.2], angle=2 * np.pi)])
    done = job(Process(lead_in=Lead(), lead_out=Lead()), Contour(path=circle, name="hole"))
    (this,) = done.runs
    _, program = programs_of(done, this)
    trajectory = plan_run(done, this, program)
    ((on, off),) = speeds_at_ends(program, trajectory)
    most = np.sqrt(0.09 * 0.01)
    assert on == pytest.approx(most, rel=2e-3) and off == pytest.approx(most, rel=2e-3)
    (contour,) = program.contours
    assert contour.work is not None and contour.work[0] < 0.01
    (warning,) = slow_ends(program, trajectory, this)
    assert warning.startswith("at 2 places the tool is slow, most at contour hole: the work ")
    assert "30 of 50 mm/s" in warning
    assert "0.09 m/s^2 allows no more on the contour's arc with a radius of 10 mm" in warning


def test_a_lead_with_too_small_an_arc_says_which_length_does() -> None:
    def warnings(length: float) -> list[str]:
        lead = Lead(shape="arc", length=length)
        done = job(Process(lead_in=lead, lead_out=lead), Contour(path=SQUARE, name="square"))
        (this,) = done.runs
        _, program = programs_of(done, this)
        return slow_ends(program, plan_run(done, this, program), this)

    (warning,) = (x for x in warnings(0.02) if "the lead's arc with a radius of" in x)
    found = re.search(r"with ([\d.]+) mm in place of 20 mm", warning)
    assert found
    # Three digits are printed.
    enough = float(found[1]) * 1e-3
    assert all("lead's arc" not in x for x in warnings(1.01 * enough))
    assert any("lead's arc" in x for x in warnings(0.95 * enough))


@pytest.mark.parametrize("end", [[0.35, 0.25], [0.35, 0.2511], [0.357, 0.2001]])
def test_the_arc_of_a_lead_is_not_taken_for_one_of_the_contour(end: list[float]) -> None:
    # Where rounding puts the joint, the place of the end may be before or behind it.
    lead = Lead(shape="arc", side="left", length=0.013)
    path = Path.polyline([[0.3, 0.2], [0.35, 0.2], end])
    done = job(Process(lead_in=lead, lead_out=lead), Contour(path=path))
    (this,) = done.runs
    _, program = programs_of(done, this)
    found = slow_ends(program, plan_run(done, this, program), this)
    assert found and not any("contour's arc" in x for x in found)


def test_automatic_leads_go_as_far_as_the_arm_reaches() -> None:
    # Outward, to 10 mm before the end of what the arm reaches, 0.465 m from its base at 0.135 m.
    path = Path.polyline([[0.4, 0.0], [0.59, 0.0]])
    done = job(Process(lead_in=Lead(), lead_out=Lead()), Contour(path=path, name="ray"))
    (this,) = done.runs
    _, program = programs_of(done, this)
    (contour,) = program.contours
    assert contour.work is not None
    after = contour.path.length - contour.work[1]
    assert 0 < after < 0.01
    trajectory = plan_run(done, this, program)
    ((on, off),) = speeds_at_ends(program, trajectory)
    assert on == pytest.approx(0.05, rel=1e-3)
    assert 0 < off <= 0.05 * (1 + 1e-9)


def test_one_lead_may_be_automatic_and_the_other_given() -> None:
    done = job(Process(lead_in=Lead(), lead_out=Lead(length=0.003)), Contour(path=BEND))
    (this,) = done.runs
    _, program = programs_of(done, this)
    (contour,) = program.contours
    assert contour.work is not None
    assert contour.path.length - contour.work[1] == pytest.approx(0.003, abs=1e-12)
    ((on, off),) = speeds_at_ends(program, plan_run(done, this, program))
    assert on == pytest.approx(0.05, rel=1e-3) and off < 0.049


def test_automatic_leads_need_the_method_optimal_and_name_their_contour(
    refuses: Callable[..., None],
) -> None:
    auto = Process(lead_in=Lead())
    refuses(lambda: run(job(auto, timing="mac")), InvalidInput, "Run taught", "optimal", "mac")
    far = Contour(path=Path.polyline([[0.5, 0.1], [0.6, 0.1]]), name="E7")
    refuses(
        lambda: run(job(auto, *TWO, far)),
        Unreachable,
        "Contour E7 is out of reach of the arm PMK-3s by up to",
    )


def test_warns_of_leads_that_are_too_short_and_of_none_that_are_not_there() -> None:
    short = job(Process(lead_in=Lead(length=0.001)), Contour(path=BEND))
    (warning,) = run(short).runs["taught"].warnings
    assert warning.startswith("Run taught: contour 1: the work begins at")
    assert "with a lead of 1 mm: a longer lead reaches more" in warning
    assert run(job(Process(), Contour(path=BEND))).runs["taught"].warnings == ()


def test_says_where_no_lead_on_that_side_helps() -> None:
    """From 50 mm/s the tool does not stop within 3 mm, however long the lead before them."""
    line = Contour(path=Path.polyline([[0.3, 0.2], [0.303, 0.2]]))
    lead = Lead(length=0.03)
    (on,) = run(job(Process(lead_in=lead), line)).runs["taught"].warnings
    assert "since it brakes for what follows on the contour: no lead makes it faster" in on
    (off,) = run(job(Process(lead_out=lead), line)).runs["taught"].warnings
    assert "since it comes from what is before it on the contour" in off
    # What the sentence says may help does.
    assert run(job(Process(lead_in=lead, lead_out=lead), line)).runs["taught"].warnings == ()


def test_runs_a_program_from_its_drawing_to_its_evaluation() -> None:
    told: list[Step] = []
    lead = Lead(length=0.01)
    process = Process(lead_in=lead, lead_out=lead, switch=Switch(), events=(Event(name="x"),))
    done = run(job(process), progress=told.append)
    result = done.runs["taught"]
    assert isinstance(result.path, Program) and isinstance(result.objective, Program)
    shares = [x for x in told if x.done is not None]
    assert shares[-2:] == [Step(("taught", "timing"), 0.5), Step(("taught", "timing"), 1.0)]
    assert [x.names[-1] for x in told if x.done is None] == [
        "rounding",
        "tracing",
        "timing",
        "clearance",
        "compensation",
        "execution",
        "evaluation",
    ]
    assert result.evaluation.contour_error.max < 2e-5
    assert len(result.evaluation.contours) == 2
    assert [x.name for x in result.trajectory.events] == ["x", "tool", "tool"] * 2 or [
        x.name for x in result.trajectory.events
    ] == ["tool", "x", "tool"] * 2
    assert result.explanation is not None and result.joint_path is None
    assert result.taught.trajectory is result.trajectory


def test_runs_of_a_program_that_differ_only_in_timing_share_their_tracing() -> None:
    one = job(Process(lead_in=Lead(length=0.01)))
    (this,) = one.runs
    mac = dataclasses.replace(this, name="mac", timing="mac", compensation="none")
    slow = dataclasses.replace(this, name="slow", limits=LIMITS.replace(speed=0.02))
    told: list[Step] = []
    runs = run(dataclasses.replace(one, runs=(this, mac, slow)), progress=told.append).runs
    assert runs["mac"].traced is runs["taught"].traced is not runs["slow"].traced
    assert runs["mac"].path is runs["taught"].path
    assert runs["mac"].trajectory.method == "mac"
    # Only steps that something is done in are told.
    steps = [x.names for x in told if x.done is None]
    assert [x for x in steps if x[1] in ("rounding", "tracing")] == [
        (name, step) for name in ("taught", "slow") for step in ("rounding", "tracing")
    ]


def test_leads_of_automatic_length_are_found_by_every_run() -> None:
    auto = job(Process(lead_in=Lead()), Contour(path=BEND), rounding=None)
    assert auto.objective is None
    (this,) = auto.runs
    less = dataclasses.replace(this, name="less", reserve=0.5)
    runs = run(dataclasses.replace(auto, runs=(this, less))).runs
    assert runs["less"].path.contours[0].work[0] > runs["taught"].path.contours[0].work[0]


def test_a_job_of_a_path_is_one_of_its_program() -> None:
    program = Program(moves=(Contour(path=BEND),))
    by_path = dataclasses.replace(job(Process(), Contour(path=BEND), until=3.0), path=BEND)
    by_program = dataclasses.replace(by_path, path=program)
    for x in (by_path, by_program):
        assert x.program.path is x.single_path is BEND
    first, second = (run(x).runs["taught"] for x in (by_path, by_program))
    assert first.path.single_path is not None and first.joint_path is not None
    np.testing.assert_array_equal(first.taught.q, second.taught.q)
    for x in (first, second):
        assert x.evaluation.until == 3.0 and len(x.evaluation.contours) == 1


def test_until_is_for_one_path(refuses: Callable[..., None]) -> None:
    led = Process(lead_in=Lead(length=0.01))
    refuses(
        lambda: job(Process(), until=3.0), InvalidInput, "until is for a job with a single path"
    )
    refuses(lambda: job(led, Contour(path=BEND), until=3.0), InvalidInput, "until")


def test_a_process_that_does_not_fit_is_refused_at_birth(refuses: Callable[..., None]) -> None:
    refuses(lambda: job(Process(from_s=1.0)), InvalidInput, "resumed at 1 m")
