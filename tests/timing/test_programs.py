"""Planned programs: continuous, at rest between moves, on their paths and within limits."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armcontour as ac
from armcontour._process import start
from armcontour._progress import Step
from armcontour.arms.limits import TOOL_LIMITS
from armcontour.errors import ArmContourError, InvalidInput, NotRealizable, Unreachable
from armcontour.geometry import Arc, Line, Path
from armcontour.motion import Trajectory
from armcontour.program import (
    Contour,
    Dwell,
    Event,
    Lead,
    Process,
    Program,
    Rapid,
    Switch,
    prepare,
    round_corners,
)
from armcontour.timing import trace_and_plan, trace_program
from armcontour.timing.fastest_configuration import trace_by_duration

PMK3S = ac.load_arm("pmk3s")
UR5E = ac.load_arm("ur5e")
IN_PLANE = PMK3S.limits.replace(speed=0.1, centripetal_acceleration=0.09)
IN_SPACE = UR5E.limits.replace(speed=0.1, centripetal_acceleration=1.0)
SQUARE = Path.polyline([[0.3, 0.1], [0.36, 0.1], [0.36, 0.14], [0.3, 0.14], [0.3, 0.1]])
BEND = Path.polyline([[0.3, 0.2], [0.35, 0.2], [0.35, 0.25]])
AROUND = Process(
    lead_in=Lead(length=0.01),
    lead_out=Lead(length=0.01),
    overlap=0.005,
    switch=Switch(name="laser", on_lead=0.02, off_lead=-0.01),
)


def in_space(path: Path, z: float = 0.1) -> Path:
    points = [[0.05, -0.3, z]]
    moved = Program(moves=(Contour(path=path),)).placed(ac.Frame(position=points[0])).path
    return moved.pointing([0, 0, -1.0])


def judged(program: Program, arm: ac.Arm, limits: ac.Limits, trajectory: Trajectory) -> None:
    """All that holds of the plan of any program, at times that no plan knows of."""
    rng = np.random.default_rng(7)
    t = np.concatenate([[0.0], np.sort(rng.uniform(0, trajectory.duration, 400))])
    # Continuous, and at rest, wherever a law follows another one.
    seams = trajectory.starts[1:-1]
    before, after = (trajectory(seams, side=x) for x in ("left", "right"))
    np.testing.assert_allclose(before, after, atol=1e-9)
    for span in trajectory.spans:
        ends = np.array(span.t)
        for at, side in zip(ends, ("right", "left"), strict=True):
            np.testing.assert_allclose(trajectory(at, 1, side=side), 0, atol=1e-9)
    # Moves follow each other without gaps, and contours come in their order.
    times = [x.t for x in trajectory.spans]
    assert times[0][0] == 0 and times[-1][1] == pytest.approx(trajectory.duration, abs=1e-12)
    for first, second in zip(times[:-1], times[1:], strict=True):
        assert second[0] == pytest.approx(first[1], abs=1e-12)
    contours = [x for x in trajectory.spans if x.kind == "contour"]
    assert len(contours) == len(program.contours)
    free = limits.replace(**dict.fromkeys(TOOL_LIMITS, None))
    for span in trajectory.spans:
        inside = t[(t > span.t[0]) & (t < span.t[1])]
        if span.trajectory is None:
            np.testing.assert_allclose(trajectory(inside, 1), 0, atol=1e-12)
            continue
        assert span.trajectory.duration == pytest.approx(span.t[1] - span.t[0], abs=1e-12)
        np.testing.assert_allclose(
            trajectory(inside), span.trajectory(inside - span.t[0]), atol=1e-9
        )
        kept = ac.check(span.trajectory, arm, limits if span.kind == "contour" else free, points=20)
        over = [(x.name, x.ratio) for x in kept.uses if x.ratio > 1 + 1e-6 and "step" not in x.name]
        assert not over, (span.kind, span.name, over)
    for span, contour, offset in zip(contours, program.contours, program.breaks, strict=False):
        found = contour.path.project(arm.forward(trajectory(np.linspace(*span.t, 300)[1:-1])))
        assert found.distance.max() < 1e-8
        # Once along all of it, overlaps included.
        times = np.linspace(*span.t, 2000)
        speed = np.linalg.norm(arm.tool_velocity(trajectory(times), trajectory(times, 1)), axis=1)
        gone = float(np.trapezoid(speed, times))
        assert gone == pytest.approx(contour.path.length, rel=1e-3)
        assert span.s == pytest.approx((offset, offset + contour.path.length), abs=1e-12)
        assert span.t[0] <= span.work[0] < span.work[1] <= span.t[1]  # type: ignore[index]
        work = contour.work or (0.0, contour.path.length)
        at = arm.forward(trajectory(np.array(span.work)))
        np.testing.assert_allclose(at, contour.path(work), atol=1e-9)
    _events_judged(program, arm, trajectory)


def _events_judged(program: Program, arm: ac.Arm, trajectory: Trajectory) -> None:
    asked = [x for x in program.moves if isinstance(x, Event)]
    asked += [x for contour in program.contours for x in contour.events]
    assert sorted(x.name for x in asked) == sorted(x.name for x in trajectory.events)
    assert [x.t for x in trajectory.events] == sorted(x.t for x in trajectory.events)
    for event in trajectory.events:
        at = arm.forward(trajectory(event.due))
        np.testing.assert_allclose(at, event.point, atol=1e-9)


def plane(process: Process = AROUND, *moves: object) -> Program:
    done = Program(moves=moves or (Contour(path=SQUARE), Contour(path=BEND)))  # type: ignore[arg-type]
    return round_corners(prepare(done, process), tolerance=5e-4)


def test_keeps_all_that_holds_of_programs_in_the_plane() -> None:
    events = (Event(name="glue", s=0.03, lead_distance=0.01), Event(name="glue2", s=0.07))
    program = plane(
        AROUND,
        Event(name="spindle", value="forward"),
        Dwell(duration=0.5),
        Contour(path=SQUARE, name="square"),
        Event(name="coolant"),
        Rapid(path=Path.polyline([[0.3, 0.1], [0.32, 0.17], [0.3, 0.2]])),
        Dwell(duration=0.1),
        Contour(path=BEND, events=events),
        Rapid(),
        Contour(path=Path.polyline([[0.36, 0.1], [0.36, 0.16]])),
        Event(name="spindle", value=False),
    )
    trajectory = ac.plan(program, PMK3S, IN_PLANE)
    judged(program, PMK3S, IN_PLANE, trajectory)
    kinds = [x.kind for x in trajectory.spans]
    # Bridges too: after the lead-out, which the hand-made rapid does not begin at.
    assert kinds[:2] == ["dwell", "contour"] and kinds[-2:] == ["rapid", "contour"]
    assert kinds.count("contour") == 3 and kinds.count("dwell") == 2
    first, last = trajectory.events[0], trajectory.events[-1]
    assert (first.name, first.t) == ("spindle", 0.0)
    # The dwell after it is for the spindle to run up.
    assert trajectory.spans[0].t == (0.0, 0.5)
    assert (last.name, last.t) == ("spindle", pytest.approx(trajectory.duration))


def test_smoothed_programs_have_all_but_the_limits() -> None:
    windows = 0.01, 0.03
    events = (Event(name="glue", s=0.03, lead_distance=0.01), Event(name="glue2", s=0.07))
    program = plane(
        AROUND,
        Contour(path=Path.polyline([[0.36, 0.1], [0.36, 0.16]])),
        Dwell(duration=0.1),
        Event(name="coolant"),
        Rapid(),
        Contour(path=BEND, events=events),
    )
    gentle = IN_PLANE.replace(centripetal_acceleration=None)
    plain = ac.plan(program, PMK3S, gentle, reserve=0.4)
    smoothed = ac.plan(program, PMK3S, gentle, reserve=0.4, smoothing=windows)
    judged(program, PMK3S, ac.Limits(), smoothed)
    assert smoothed.method == "optimal, smoothed"
    assert [x.kind for x in smoothed.spans] == [x.kind for x in plain.spans]
    for before, after in zip(plain.spans, smoothed.spans, strict=True):
        longer = 0.0 if before.kind == "dwell" else sum(windows)
        assert np.ptp(after.t) == pytest.approx(np.ptp(before.t) + longer, abs=1e-12)
    # Path accelerations no longer jump, at starts and ends of moves neither.
    jumps = [
        np.abs(np.subtract(*(x.s(x.breaks, 2, side=side) for side in ("left", "right")))).max()
        for x in (plain, smoothed)
    ]
    assert jumps[1] < 1e-6 < 1e-1 < jumps[0]


def test_keeps_all_that_holds_of_programs_in_space() -> None:
    moves = (Contour(path=in_space(SQUARE)), Contour(path=in_space(BEND)))
    process = dataclasses.replace(AROUND, approach=0.02, retract=0.03)
    program = round_corners(
        prepare(Program(moves=moves), process), tolerance=5e-4, angular_tolerance=0.1
    )
    trajectory = ac.plan(program, UR5E, IN_SPACE)
    judged(program, UR5E, IN_SPACE, trajectory)
    kinds = [x.kind for x in trajectory.spans]
    assert kinds == ["rapid", "contour", "rapid", "rapid", "rapid", "contour", "rapid"]
    # The joints stay in the configuration that they are in.
    q = trajectory(np.linspace(0, trajectory.duration, 500))
    assert np.abs(q - q[0]).max() < 1.0


@pytest.mark.parametrize("method", ["mac", "conventional"])
def test_the_other_methods_plan_programs_too(method: str) -> None:
    events = (Event(name="a", s=0.013), Event(name="b", s=0.06, lead_time=0.05))
    program = plane(
        Process(switch=Switch()), Contour(path=SQUARE), Contour(path=BEND, events=events)
    )
    limits = PMK3S.limits.replace(speed=0.05, centripetal_acceleration=0.09)
    trajectory = ac.plan(program, PMK3S, limits, method=method)
    assert trajectory.method == method
    for span in trajectory.spans:
        if method == "mac":
            np.testing.assert_allclose(trajectory(span.t[0], 1), 0, atol=1e-9)
    seams = trajectory.starts[1:-1]
    np.testing.assert_allclose(trajectory(seams, side="left"), trajectory(seams), atol=1e-9)
    assert len(trajectory.events) == 6
    for event in trajectory.events:
        here = PMK3S.forward(trajectory(event.due))
        span = next(x for x in trajectory.spans if x.s[0] <= event.s <= x.s[1] and x.work)
        contour = program.contours[[x for x in trajectory.spans if x.work].index(span)]
        s = event.s - span.s[0]
        # Between its knots "mac" leaves the path; along it the tool is at the place.
        along = (here - event.point) @ contour.path(s, 1, side="left" if s else "right")
        assert abs(along) < 1e-9
        assert np.linalg.norm(here - event.point) < 1e-4
    b = next(x for x in trajectory.events if x.name == "b")
    assert b.t == pytest.approx(b.due - 0.05, abs=1e-15)


def test_leads_of_events_are_exact_in_time_and_along_the_path() -> None:
    events = (
        Event(name="a", s=0.03, lead_distance=0.01),
        Event(name="b", s=0.02),
        Event(name="c", s=0.03, lead_time=0.25),
        Event(name="d", s=0.03, lead_time=-0.25),
        Event(name="e", s=0.03, lead_distance=-0.02),
        Event(name="f", s=0.05),
        Event(name="g", s=0.03, lead_distance=0.01, lead_time=0.1),
        Event(name="h", s=0.01, lead_distance=0.01),
    )
    program = Program(moves=(Contour(path=BEND, events=events),))
    timed = {x.name: x for x in ac.plan(program, PMK3S, IN_PLANE).events}
    assert timed["a"].t == pytest.approx(timed["b"].due, abs=1e-12)
    assert timed["a"].due == timed["c"].due == timed["d"].due
    assert timed["c"].t == pytest.approx(timed["c"].due - 0.25, abs=1e-12)
    assert timed["d"].t == pytest.approx(timed["d"].due + 0.25, abs=1e-12)
    assert timed["e"].t == pytest.approx(timed["f"].due, abs=1e-12)
    assert timed["g"].t == pytest.approx(timed["b"].due - 0.1, abs=1e-12)
    assert timed["h"].t == 0.0


def test_an_event_may_lead_by_the_whole_lead_in_whatever_sums_round_to() -> None:
    for length in (0.01, 0.0173, 0.1 / 3, 0.02 + 1e-17):
        event = Event(name="glue", s=0.0, lead_distance=length)
        process = Process(lead_in=Lead(length=length), begin=0.07, overlap=0.0123)
        program = plane(process, Contour(path=SQUARE, events=(event,)))
        (timed,) = ac.plan(program, PMK3S, IN_PLANE).events
        assert timed.t == pytest.approx(0, abs=1e-6)
    # As far after the end as a contour takes it.
    late = Contour(path=BEND, events=(Event(name="x", s=0.1 + 0.9e-9),))
    (timed,) = ac.plan(Program(moves=(late,)), PMK3S, IN_PLANE).events
    np.testing.assert_allclose(timed.point, BEND(0.1), atol=1e-9)


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (Event(name="x", s=0.01, lead_distance=0.02), ("contour E7", "x", "lead-in")),
        (Event(name="x", s=0.09, lead_distance=-0.02), ("contour E7", "x", "0.1 m")),
        (Event(name="x", s=0.0, lead_time=0.1), ("x", "0.1 s before the motion begins")),
    ],
)
def test_refuses_events_that_come_off_the_contour_or_before_the_motion(
    event: Event, words: tuple[str, ...], refuses: Callable[..., None]
) -> None:
    program = Program(moves=(Contour(path=BEND, name="E7", events=(event,)),))
    refuses(lambda: ac.plan(program, PMK3S, IN_PLANE), InvalidInput, *words)


def test_a_dwell_before_the_first_contour_makes_time_for_an_early_event() -> None:
    event = Event(name="x", s=0.0, lead_time=0.1)
    moves = (Dwell(duration=0.15), Contour(path=BEND, events=(event,)))
    (timed,) = ac.plan(Program(moves=moves), PMK3S, IN_PLANE).events
    assert (timed.t, timed.due) == pytest.approx((0.05, 0.15), abs=1e-12)


@pytest.mark.parametrize("arm", [PMK3S, UR5E], ids=lambda x: x.name)
def test_free_rapids_are_bang_bang_at_the_limits_of_the_joints(arm: ac.Arm) -> None:
    paths = (SQUARE, BEND) if arm is PMK3S else (in_space(SQUARE), in_space(BEND))
    # Limits that do not bind but for joint acceleration and velocity, and rapids have none of the
    # tool's.
    limits = arm.limits.replace(
        speed=0.05,
        centripetal_acceleration=0.05,
        tool_acceleration=0.5,
        joint_torque=None,
        joint_acceleration=np.linspace(2.0, 3.0, arm.dof),
        joint_velocity=np.linspace(0.3, 0.4, arm.dof),
    )
    trajectory = ac.plan(
        Program(moves=tuple(Contour(path=x) for x in paths)), arm, limits, method="optimal"
    )
    (rapid,) = (x for x in trajectory.spans if x.kind == "rapid")
    begin, end = (trajectory(t) for t in rapid.t)
    way = np.abs(end - begin)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Along the straight line the joint with the least share of its limits rules.
        rate = float(np.nanmin(np.linspace(0.3, 0.4, arm.dof) / way))
        pull = float(np.nanmin(np.linspace(2.0, 3.0, arm.dof) / way))
    # In shares of the way: up at `pull` to `rate` if there is room, and down again.
    least = 2 / np.sqrt(pull) if rate**2 / pull >= 1 else 1 / rate + rate / pull
    assert rapid.t[1] - rapid.t[0] == pytest.approx(least, rel=1e-3)
    t = np.linspace(*rapid.t, 50)
    share = (trajectory(t) - begin) @ (end - begin) / ((end - begin) @ (end - begin))
    np.testing.assert_allclose(trajectory(t), begin + share[:, None] * (end - begin), atol=1e-9)


def test_contours_that_meet_need_no_rapid() -> None:
    second = Path.polyline([[0.35, 0.25], [0.3, 0.25]])
    program = Program(moves=(Contour(path=BEND), Rapid(), Contour(path=second)))
    assert [x.kind for x in ac.plan(program, PMK3S, IN_PLANE).spans] == ["contour", "contour"]


def test_a_reserve_is_left_on_rapids_too() -> None:
    program = Program(moves=(Contour(path=BEND), Contour(path=SQUARE)))
    ratios = []
    for reserve in (0.0, 0.4):
        trajectory = ac.plan(program, PMK3S, IN_PLANE, reserve=reserve)
        for span in trajectory.spans:
            assert span.trajectory is not None
            use = ac.check(span.trajectory, PMK3S, PMK3S.limits)["joint_acceleration"].ratio
            assert use <= 1 - reserve + 1e-6
            if span.kind == "rapid":
                ratios.append(use)
    assert ratios == pytest.approx([1.0, 0.6], abs=1e-3)


def test_a_contour_takes_the_time_that_it_takes_alone() -> None:
    alone = [ac.plan(x, PMK3S, IN_PLANE).duration for x in (SQUARE, BEND)]
    program = Program(moves=(Contour(path=SQUARE), Contour(path=BEND)))
    spans = [x for x in ac.plan(program, PMK3S, IN_PLANE).spans if x.kind == "contour"]
    assert [x.t[1] - x.t[0] for x in spans] == pytest.approx(alone, rel=1e-9)


def test_errors_name_the_contour_or_the_rapid(refuses: Callable[..., None]) -> None:
    far = Path.polyline([[0.5, 0.2], [0.6, 0.2]])
    second = Program(moves=(Contour(path=BEND), Contour(path=far, name="E7")))
    refuses(lambda: ac.plan(second, PMK3S, IN_PLANE), Unreachable, "contour E7:", "out of reach")
    over = Rapid(path=Path.polyline([[0.35, 0.25], [0.5, 0.5], [0.3, 0.1]]))
    moves = (Contour(path=BEND), over, Contour(path=SQUARE))
    refuses(
        lambda: ac.plan(Program(moves=moves), PMK3S, IN_PLANE), Unreachable, "rapid to contour 2:"
    )
    refuses(
        lambda: ac.plan(Program(moves=moves[:2]), PMK3S, IN_PLANE),
        Unreachable,
        "rapid away from contour 1:",
    )
    arc = Path.from_segments(
        [
            Arc(start=[0.3, 0.2], center=[0.3, 0.22], angle=1.0),
            Line(start=[0.3, 0.2], end=[0.3, 0.3]),
        ][:1]
    )
    refuses(
        lambda: ac.plan(
            Program(moves=(Contour(path=arc, name="E8"),)), PMK3S, IN_PLANE, method="mac"
        ),
        NotRealizable,
        "contour E8:",
    )


@pytest.mark.parametrize("option", ["start_speed", "end_speed", "grid"])
def test_options_of_one_path_are_refused_for_programs(
    option: str, refuses: Callable[..., None]
) -> None:
    program = Program(moves=(Contour(path=BEND), Contour(path=SQUARE)))
    given = np.linspace(0, 0.1, 50) if option == "grid" else 0.02
    refuses(
        lambda: ac.plan(program, PMK3S, IN_PLANE, **{option: given}), InvalidInput, option, "rest"
    )


def test_tells_how_many_contours_are_done() -> None:
    told: list[Step] = []
    program = Program(moves=(Contour(path=BEND), Rapid(), Contour(path=SQUARE)))
    ac.plan(program, PMK3S, IN_PLANE, progress=told.append)
    assert told == [Step(("timing",), 0.5), Step(("timing",), 1.0)]


def test_explains_every_contour_of_a_program_in_its_own_time_and_place() -> None:
    program = plane()
    trajectory = ac.plan(program, PMK3S, IN_PLANE)
    told = ac.explain(trajectory, PMK3S, IN_PLANE)
    spans = [x for x in trajectory.spans if x.kind == "contour"]
    alone = [
        ac.explain(ac.plan(x.path, PMK3S, IN_PLANE), PMK3S, IN_PLANE) for x in program.contours
    ]
    assert [x.name for x in told.bindings] == [x.name for one in alone for x in one.bindings]
    own = iter(told.bindings)
    for one, span in zip(alone, spans, strict=True):
        for x in one.bindings:
            y = next(own)
            assert y.t == pytest.approx([t + span.t[0] for t in x.t], abs=1e-9)
            assert y.s == pytest.approx([s + span.s[0] for s in x.s], abs=1e-9)
    lengths = [x.path.length for x in program.contours]
    share = np.average([x.assigned_length for x in alone], weights=lengths)  # type: ignore[misc]
    assert told.assigned_length == pytest.approx(share, abs=1e-9)


def test_what_comes_before_the_first_contour_keeps_its_order() -> None:
    moves = (
        Dwell(duration=0.1),
        Event(name="spindle"),
        Dwell(duration=0.5),
        Event(name="coolant"),
        Contour(path=BEND),
        Event(name="spindle", value=False),
        Dwell(duration=0.2),
        Event(name="coolant", value=False),
    )
    trajectory = ac.plan(Program(moves=moves), PMK3S, IN_PLANE)
    end = trajectory.duration
    expected = [0.1, 0.6, end - 0.2, end]
    assert [x.t for x in trajectory.events] == pytest.approx(expected, abs=1e-12)
    assert [x.move for x in trajectory.spans] == [0, 2, 4, 6]
    assert [x.s for x in trajectory.events] == pytest.approx([0, 0, 0.1, 0.1], abs=1e-12)


coordinates = st.tuples(st.floats(0.25, 0.36), st.floats(0.08, 0.24))


@st.composite
def contours(draw: st.DrawFn) -> Contour:
    """A polyline or an arc in reach of the arm, perhaps with events."""
    if draw(st.booleans()):
        points = draw(st.lists(coordinates, min_size=2, max_size=4, unique=True))
        if draw(st.booleans()) and len(points) > 2:
            points.append(points[0])
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if steps.min() < 2e-3:
            points = [[0.3, 0.1], [0.33, 0.12]]  # type: ignore[list-item]
        path = Path.polyline(points)
    else:
        x, y = draw(coordinates)
        angle = draw(st.sampled_from([2 * np.pi, 1.0, -2.5, np.pi]))
        radius = draw(st.floats(3e-3, 2e-2))
        path = Path.from_segments([Arc(start=[x, y], center=[x - radius, y], angle=angle)])
    shares = draw(st.lists(st.floats(0, 1), max_size=2))
    events = tuple(Event(name=f"e{i}", s=x * path.length) for i, x in enumerate(shares))
    return Contour(path=path, name=draw(st.sampled_from(["", "c"])), events=events)


between = st.sampled_from(
    [(), (Rapid(),), (Dwell(duration=0.05),), (Event(name="m"),), (Event(name="m"), Rapid())]
)
leads = st.one_of(
    st.none(),
    st.builds(
        Lead,
        length=st.floats(1e-3, 0.02),
        shape=st.sampled_from(["line", "arc"]),
        side=st.sampled_from(["left", "right"]),
    ),
)
processes = st.builds(
    Process,
    begin=st.sampled_from(["auto", "drawn", 0.013, (0.3, 0.1)]),
    overlap=st.sampled_from([0.0, 0.004]),
    lead_in=leads,
    lead_out=leads,
    switch=st.sampled_from([None, Switch(), Switch(on_lead=0.03, off_lead=-0.02)]),
    from_s=st.sampled_from([0.0, 0.0, 0.031]),
)


@settings(max_examples=12)
@given(st.lists(st.tuples(between, contours()), min_size=1, max_size=4), processes)
def test_whatever_the_program_it_is_kept_or_refused_with_a_sentence(
    drawn: list[tuple[tuple[object, ...], Contour]], process: Process
) -> None:
    moves = [x for before, contour in drawn for x in (*before, contour)]
    try:
        program = round_corners(
            prepare(Program(moves=tuple(moves)), process),  # type: ignore[arg-type]
            tolerance=5e-4,
        )
        trajectory = ac.plan(program, PMK3S, IN_PLANE)
    except ArmContourError as error:
        sentence = str(error)
        assert sentence.endswith(".") and "\n" not in sentence
        return
    judged(program, PMK3S, IN_PLANE, trajectory)


def there_and_back(*, axis_only: bool) -> Program:
    """A line, a rapid, and a line back, with the tool following both."""
    lines = ([[0.4, 0, 0.2], [0.45, 0, 0.2]], [[0.45, 0.01, 0.2], [0.4, 0.01, 0.2]])
    first, second = (
        Contour(path=Path.polyline(x).following_tangent([0, 0, 1], axis_only=axis_only))
        for x in lines
    )
    over = Path.polyline([[0.45, 0, 0.2], [0.45, 0, 0.22], [0.45, 0.01, 0.22], [0.45, 0.01, 0.2]])
    return Program(moves=(first, Rapid(path=over), second))


def test_a_rapid_turns_the_tool_by_half_a_turn_between_lines_there_and_back() -> None:
    spans = ac.plan(there_and_back(axis_only=False), UR5E, IN_SPACE).spans
    # No motion on the spot before or after it.
    assert [x.kind for x in spans] == ["contour", "rapid", "contour"]


def test_a_rapid_does_not_turn_about_an_axis_that_is_free_to_turn() -> None:
    trajectory = ac.plan(there_and_back(axis_only=True), UR5E, IN_SPACE)
    (rapid,) = (x for x in trajectory.spans if x.kind == "rapid")
    turned = np.ptp(trajectory(np.linspace(*rapid.t, 50)), axis=0)
    assert turned.max() < 0.2


def test_an_event_that_lags_beyond_the_end_asks_for_a_lead_out(
    refuses: Callable[..., None],
) -> None:
    late = Contour(path=BEND, events=(Event(name="x", s=0.09, lead_distance=-0.02),))
    refuses(
        lambda: ac.plan(Program(moves=(late,)), PMK3S, IN_PLANE),
        InvalidInput,
        "lags by 0.02",
        "lead-out",
        allowed=0.01,
    )


def test_of_configurations_as_fast_for_a_contour_that_for_the_next_ones_is_chosen() -> None:
    # The speed of the tool bounds both contours; the way between them depends on the posture.
    moves = Contour(path=in_space(SQUARE)), Contour(path=in_space(BEND, 0.3))
    program = Program(moves=moves)
    rounded = round_corners(program, tolerance=1e-3)
    limits = IN_SPACE.replace(speed=0.02, joint_torque=None)
    equals = next(trace_by_duration(rounded.contours[0].path, UR5E, limits))
    assert len(equals) > 1
    durations = [ac.plan(rounded, UR5E, limits, start=x(0.0)).duration for x in equals]
    assert max(durations) > 1.001 * min(durations)
    found = ac.plan(rounded, UR5E, limits)
    assert found.duration == pytest.approx(min(durations), rel=1e-6)


def test_an_approach_does_not_choose_another_configuration_than_the_contour() -> None:
    square = SQUARE.vertices + [0.2, 0.1]
    path = Path.polyline(np.pad(square, ((0, 0), (0, 1)), constant_values=0.3)).pointing([0, 0, -1])
    drawn = Program(moves=(Contour(path=path),))
    alone = ac.plan(drawn, UR5E, IN_SPACE)
    led = ac.plan(prepare(drawn, Process(begin="drawn", approach=0.03)), UR5E, IN_SPACE)
    approach, contour = led.spans
    assert (approach.kind, contour.kind) == ("rapid", "contour")
    assert contour.t[1] - contour.t[0] == pytest.approx(alone.duration, rel=1e-3)
    np.testing.assert_allclose(led(contour.t[0]), alone(0.0), atol=0.1)


def test_leads_that_would_change_the_order_of_switching_are_refused(refuses):
    arm = ac.load_arm("pmk3s")
    dashes = [ac.Path.polyline([(x, 0.1), (x + 0.004, 0.1)]) for x in (0.30, 0.32)]
    program = ac.Program(moves=tuple(ac.Contour(path=x) for x in dashes))
    limits = arm.limits.replace(speed=0.05)

    def planned(**leads):
        switch = ac.Switch(name="glue", **leads)
        process = ac.Process(lead_in=ac.Lead(length=2e-3), switch=switch)
        return ac.plan(ac.prepare(program, process), arm, limits)

    kept = planned(off_lead=0.01)
    assert [x.value for x in kept.events] == [True, False, True, False]
    # So early that the tool would go off before it goes on.
    most = kept.events[1].due - kept.events[0].due
    refuses(
        lambda: planned(off_lead=1.1 * most),
        ac.InvalidInput,
        "The event glue to False at",
        "before the one to True",
        "give it less advance",
    )


def test_a_dwell_before_every_contour_gives_time_to_what_leads():
    arm = ac.load_arm("pmk3s")
    path = ac.Path.polyline([(0.30, 0.1), (0.33, 0.1)])
    program = ac.Program(moves=(ac.Contour(path=path),))
    process = ac.Process(dwell=0.4, switch=ac.Switch(on_lead=0.4))
    planned = ac.plan(ac.prepare(program, process), arm, arm.limits.replace(speed=0.05))
    assert [x.kind for x in planned.spans] == ["dwell", "contour"]
    first = planned.events[0]
    assert (first.t, first.due) == (pytest.approx(0.0, abs=1e-12), pytest.approx(0.4))


def test_the_tool_pierces_at_rest_above_the_waste_and_the_process_is_on_from_then_on() -> None:
    lead, height = Lead(length=8e-3, shape="arc", active=True), 3e-3
    process = Process(
        lead_in=lead,
        lead_out=lead,
        pierce=ac.Pierce(time=0.3, height=height),
        approach=0.01,
        retract=0.01,
        dwell=0.1,
        switch=Switch(name="laser", on_lead=0.02),
    )
    moves = (Contour(path=in_space(SQUARE)), Contour(path=in_space(SQUARE, z=0.12)))
    program = round_corners(prepare(Program(moves=moves), process), tolerance=5e-4)
    plan = ac.plan(program, UR5E, IN_SPACE)
    judged(program, UR5E, IN_SPACE, plan)
    kinds = [x.kind for x in plan.spans]
    first = ["rapid", "dwell", "contour", "rapid"]
    assert kinds == [*first, "rapid", *first]
    on, off = plan.events[::2], plan.events[1::2]
    assert all(x.value is True for x in on) and all(x.value is False for x in off)
    for contour, span, begin, end in zip(
        program.contours, plan.contour_spans, on, off, strict=True
    ):
        # Ready for 0.3 s at the height, and off where the tool leaves the waste again.
        assert begin.t == pytest.approx(span.t[0] - 0.32) and end.t == pytest.approx(span.t[1])
        pierced = UR5E.forward(plan(np.linspace(begin.t, span.t[0], 50)))
        np.testing.assert_allclose(pierced, np.tile(pierced[0], (50, 1)), atol=1e-9)
        tool = UR5E.forward(plan(np.linspace(*span.t, 4000)))
        assert pierced[0, 2] - tool[-1, 2] == pytest.approx(height)
        # Straight down and then along the level.
        high = tool[:, 2] > tool[-1, 2] + 1e-9
        np.testing.assert_allclose(tool[high, :2], pierced[0, :2] + 0 * tool[high, :2], atol=1e-9)
        # The pierce is beside the contour, at the size of the quarter circle.
        nearest = contour.path(np.linspace(*contour.at_work, 4000))[:, :2] - pierced[0, :2]
        radius = lead.length / (np.pi / 2)
        assert np.linalg.norm(nearest, axis=1).min() == pytest.approx(radius, rel=1e-3)


@pytest.mark.parametrize("method", ["optimal", "mac", "conventional"])
def test_a_path_a_program_of_it_and_its_joint_path_have_one_plan(method: str) -> None:
    path = ac.round_corners(BEND, tolerance=1e-3)
    program = Program(moves=(Contour(path=path),))
    traced = trace_program(program, PMK3S, IN_PLANE)
    plans = [
        ac.plan(x, PMK3S, IN_PLANE, method=method)
        for x in (path, program, ac.trace(path, PMK3S), traced)
    ]
    t = np.linspace(0, plans[0].duration, 500)
    for x in plans:
        assert x.duration == plans[0].duration and x.path is path
        assert [y.name for y in x.stretches] == [y.name for y in plans[0].stretches]
        for order in (0, 1, 2):
            np.testing.assert_array_equal(x(t, order), plans[0](t, order))
        (span,) = x.spans
        assert span.t == span.work == (0.0, x.duration) and span.s == (0.0, path.length)


def test_options_of_one_path_hold_for_a_program_of_one() -> None:
    program = Program(moves=(Contour(path=BEND),))
    options = {"start_speed": 0.02, "end_speed": 0.01}
    found = ac.plan(program, PMK3S, IN_PLANE, **options)
    alone = ac.plan(BEND, PMK3S, IN_PLANE, **options)
    assert found.duration == alone.duration
    np.testing.assert_allclose(found.speed_at([0.0, BEND.length], side="left")[1], 0.01)
    np.testing.assert_allclose(found.s(0.0, 1), 0.02)


def test_a_traced_program_is_timed_again_without_tracing(
    monkeypatch: pytest.MonkeyPatch, refuses: Callable[..., None]
) -> None:
    program = prepare(Program(moves=(Contour(path=SQUARE), Contour(path=BEND))), AROUND)
    traced = trace_program(program, PMK3S, IN_PLANE)
    whole = ac.plan(program, PMK3S, IN_PLANE, reserve=0.2)

    def never(*_: object, **__: object) -> None:
        raise AssertionError("traced again")

    tracing = sys.modules["armcontour.timing.program_tracing"]
    monkeypatch.setattr(tracing, "trace_by_duration", never)
    monkeypatch.setattr(tracing, "trace", never)
    again = ac.plan(traced, PMK3S, IN_PLANE, reserve=0.2)
    assert again.duration == whole.duration and again.events == whole.events
    assert [x.t for x in again.spans] == [x.t for x in whole.spans]
    narrow = IN_PLANE.replace(joint_upper=traced.joint_paths[0](0.0) + 0.01)
    refuses(lambda: ac.plan(traced, PMK3S, narrow), Unreachable, "contour 1:", "upper limit")
    refuses(lambda: ac.plan(traced, UR5E), InvalidInput, "2 joints", "6")
    refuses(lambda: ac.plan(traced, PMK3S, branch="negative"), InvalidInput, "branch")


def test_tracing_tells_how_many_contours_are_done() -> None:
    told: list[Step] = []
    program = Program(moves=(Contour(path=BEND), Rapid(), Contour(path=SQUARE)))
    trace_program(program, PMK3S, IN_PLANE, progress=told.append)
    assert told == [Step(("tracing",), 0.5), Step(("tracing",), 1.0)]


def test_plans_made_ahead_are_the_same(monkeypatch):
    places = [(0.25 + 0.02 * i, 0.1 + 0.02 * j) for i in range(4) for j in range(5)]
    size = np.array([[0, 0], [0.01, 0], [0.01, 0.01]])
    program = Program(moves=tuple(Contour(path=Path.polyline(size + x)) for x in places))
    traced = trace_program(program, PMK3S, IN_PLANE)
    told: list[Step] = []

    def planned() -> Trajectory:
        return ac.plan(traced, PMK3S, IN_PLANE, smoothing=0.02, progress=told.append)

    alone = planned()
    # From the second move on.
    monkeypatch.setattr("armcontour._processes.ALONE", 1e-9)
    ahead = planned()
    t = np.linspace(0, alone.duration, 999)
    assert np.array_equal(alone.starts, ahead.starts)
    assert all(np.array_equal(alone(t, k), ahead(t, k)) for k in range(3))
    assert told[:20] == told[20:] == [Step(("timing",), (k + 1) / 20) for k in range(20)]


def test_moves_are_planned_while_others_are_still_traced(monkeypatch):
    lines = [Path.polyline([[0.3, y], [0.31, y]]) for y in np.linspace(-0.1, 0.1, 12)]
    program = Program(moves=tuple(Contour(path=in_space(x)) for x in lines))
    alone = ac.plan(program, UR5E, IN_SPACE, intervals=100)
    monkeypatch.setattr("armcontour._processes.ALONE", 1e-9)
    monkeypatch.setattr("armcontour._processes.processors", lambda: 2)
    told: list[Step | str] = []

    def started() -> subprocess.Popen[bytes]:
        told.append("started")
        return start()

    monkeypatch.setattr("armcontour._processes.start", started)
    traced, ahead = trace_and_plan(program, UR5E, IN_SPACE, intervals=100, progress=told.append)
    t = np.linspace(0, alone.duration, 999)
    assert all(np.array_equal(alone(t, k), ahead(t, k)) for k in range(3))
    assert told.index("started") < told.index(Step(("tracing",), 0.5))
    steps = [x.names[0] for x in told if x != "started"]
    assert steps == ["tracing"] * 12 + ["timing"] * 13
    assert len(traced.joint_paths) == 23


def test_what_cannot_be_traced_is_said_before_what_cannot_be_planned(monkeypatch):
    """The first contour is too far out for a weak joint, the last one out of reach."""
    lines = [Path.polyline([[x, 0.0], [x + 0.01, 0.0]]) for x in [*[0.65] * 6, 2.0]]
    program = Program(moves=tuple(Contour(path=in_space(x)) for x in lines))
    weak = IN_SPACE.replace(joint_torque=[150, 44, 150, 28, 28, 28])
    monkeypatch.setattr("armcontour._processes.ALONE", 1e-9)
    with pytest.raises(Unreachable, match="contour 7:"):
        ac.plan(program, UR5E, weak, intervals=100)


def test_what_cannot_be_planned_is_said_in_its_place(monkeypatch):
    """Of several contours too far out for a weak joint the first one is named."""
    lines = [Path.polyline([[x, 0.0], [x + 0.01, 0.0]]) for x in np.linspace(0.3, 0.65, 10)]
    program = Program(moves=tuple(Contour(path=in_space(x)) for x in lines))
    weak = IN_SPACE.replace(joint_torque=[150, 44, 150, 28, 28, 28])
    traced = trace_program(program, UR5E, weak)
    refused = []
    for alone in (1e9, 1e-9):
        monkeypatch.setattr("armcontour._processes.ALONE", alone)
        with pytest.raises(NotRealizable, match="joint 2 torque") as found:
            ac.plan(traced, UR5E, weak, intervals=100)
        refused.append(str(found.value))
    assert refused[0] == refused[1]
    number = int(re.match(r"contour (\d+):", refused[0])[1])
    assert 3 < number < 10
