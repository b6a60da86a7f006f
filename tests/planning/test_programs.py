"""Planned programs: continuous, at rest between moves, on their paths and within limits."""

import dataclasses
import sys

import numpy as np
import pytest
from hypothesis import strategies as st
from scipy.integrate import trapezoid

import armcontour as ac
from armcontour.core.errors import InvalidInput, NotRealizable, Unreachable
from armcontour.core.progress import Step
from armcontour.geometry import Arc, Path
from armcontour.jobs.methods import TIMINGS
from armcontour.planning import trace_program
from armcontour.planning.program_tracing import trace_by_duration
from armcontour.program import Contour, Dwell, Event, Lead, Pierce, Process, Program, Rapid, Switch
from armcontour.robot.limits import TOOL_LIMITS

PMK3S = ac.load_arm("pmk3s")
UR5E = ac.load_arm("ur5e")
IN_PLANE = PMK3S.limits.replace(speed=0.1, centripetal_acceleration=0.09)
IN_SPACE = UR5E.limits.replace(speed=0.1, centripetal_acceleration=1.0)
SQUARE = Path.polyline([[0.3, 0.1], [0.36, 0.1], [0.36, 0.14], [0.3, 0.14], [0.3, 0.1]])
LINE = Path.polyline([[0.36, 0.1], [0.36, 0.16]])
BEND = Path.polyline([[0.3, 0.2], [0.35, 0.2], [0.35, 0.25]])
TWO = Program(moves=(Contour(path=BEND), Rapid(), Contour(path=SQUARE)))
AROUND = Process(
    lead_in=Lead(length=0.01),
    lead_out=Lead(length=0.01),
    overlap=0.005,
    switch=Switch(name="laser", on_lead=0.02, off_lead=-0.01),
)
GLUE = Event(name="glue", s=0.02), Event(name="glue2", s=0.07)


def program_of(*moves):
    return Program(moves=tuple(Contour(path=x) if isinstance(x, Path) else x for x in moves))


def in_space(path, z=0.1):
    point = [0.05, -0.3, z]
    return program_of(path).placed(ac.Frame(position=point)).path.pointing([0, 0, -1.0])


def plane(*moves, process=AROUND):
    return ac.round_corners(
        ac.prepare(program_of(*(moves or (SQUARE, BEND))), process), tolerance=5e-4
    )


def judged(program, arm, limits, trajectory):
    """All that holds of the plan of any program, at times that no plan knows of."""
    rng = np.random.default_rng(7)
    t = np.concatenate([[0.0], np.sort(rng.uniform(0, trajectory.duration, 400))])
    # Continuous, and at rest, wherever a law follows another one.
    seams = trajectory.starts[1:-1]
    spans = trajectory.spans
    before, after = (trajectory(seams, side=x) for x in ("left", "right"))
    np.testing.assert_allclose(before, after, atol=1e-9)
    for side, positions in (("right", [x.t[0] for x in spans]), ("left", [x.t[1] for x in spans])):
        np.testing.assert_allclose(trajectory(positions, 1, side=side), 0, atol=1e-9)
    # Moves follow each other without gaps, and contours come in their order.
    times = np.array([x.t for x in spans])
    assert times[0, 0] == 0
    ends = np.append(times[1:, 0], trajectory.duration)
    np.testing.assert_allclose(times[:, 1], ends, atol=1e-12)
    contours = [x for x in spans if x.kind == "contour"]
    assert len(contours) == len(program.contours)
    free = limits.replace(**dict.fromkeys(TOOL_LIMITS, None))
    for span in spans:
        inside = t[(t > span.t[0]) & (t < span.t[1])]
        if span.trajectory is None:
            np.testing.assert_allclose(trajectory(inside, 1), 0, atol=1e-12)
            continue
        assert span.trajectory.duration == pytest.approx(span.t[1] - span.t[0], abs=1e-12)
        positions_in_span = span.trajectory(inside - span.t[0])
        np.testing.assert_allclose(trajectory(inside), positions_in_span, atol=1e-9)
        check = ac.check(
            span.trajectory, arm, limits if span.kind == "contour" else free, points=20
        )
        over = [
            (x.name, x.ratio) for x in check.uses if x.ratio > 1 + 1e-6 and "step" not in x.name
        ]
        assert not over, (span.kind, span.name, over)
    for span, contour, offset in zip(contours, program.contours, program.breaks, strict=False):
        projection = contour.path.project(
            arm.tool_position(trajectory(np.linspace(*span.t, 300)[1:-1]))
        )
        assert projection.distance.max() < 1e-8
        # Once along all of it, overlaps included.
        times = np.linspace(*span.t, 2000)
        speed = np.linalg.norm(arm.tool_velocity(trajectory(times), trajectory(times, 1)), axis=1)
        assert trapezoid(speed, times) == pytest.approx(contour.path.length, rel=1e-3)
        assert span.s == pytest.approx((offset, offset + contour.path.length), abs=1e-12)
        assert span.t[0] <= span.work[0] < span.work[1] <= span.t[1]
        work = contour.work or (0.0, contour.path.length)
        positions = arm.tool_position(trajectory(np.array(span.work)))
        np.testing.assert_allclose(positions, contour.path(work), atol=1e-9)
    requested = [x for x in program.moves if isinstance(x, Event)]
    requested += [x for contour in program.contours for x in contour.events]
    assert sorted(x.name for x in requested) == sorted(x.name for x in trajectory.events)
    assert [x.t for x in trajectory.events] == sorted(x.t for x in trajectory.events)
    for event in trajectory.events:
        positions = arm.tool_position(trajectory(event.due))
        np.testing.assert_allclose(positions, event.point, atol=1e-9)


def test_programs_in_the_plane_are_planned_with_events_and_dwells():
    start = Event(name="spindle", value="forward")
    stop = Event(name="spindle", value=False)
    over = Rapid(path=Path.polyline([[0.3, 0.1], [0.32, 0.17], [0.3, 0.2]]))
    moves = start, Dwell(duration=0.5), Contour(path=SQUARE, name="square"), Event(name="coolant")
    moves += over, Dwell(duration=0.1), Contour(path=BEND, events=GLUE), Rapid(), LINE, stop
    program = plane(*moves)
    trajectory = ac.plan(program, PMK3S, IN_PLANE)
    judged(program, PMK3S, IN_PLANE, trajectory)
    kinds = [x.kind for x in trajectory.spans]
    # Bridges too: after the lead-out, which the hand-made rapid does not begin at.
    assert kinds[:2] == ["dwell", "contour"] and kinds[-2:] == ["rapid", "contour"]
    assert kinds.count("contour") == 3 and kinds.count("dwell") == 2
    first = trajectory.events[0]
    last = trajectory.events[-1]
    assert (first.name, first.t) == ("spindle", 0.0)
    # The dwell after it is for the spindle to run up.
    assert trajectory.spans[0].t == (0.0, 0.5)
    assert (last.name, last.t) == ("spindle", pytest.approx(trajectory.duration))


def test_programs_in_space_are_planned_within_their_limits():
    process = dataclasses.replace(AROUND, approach=0.02, retract=0.03)
    program = ac.prepare(program_of(in_space(SQUARE), in_space(BEND)), process)
    program = ac.round_corners(program, tolerance=5e-4, angular_tolerance=0.1)
    trajectory = ac.plan(program, UR5E, IN_SPACE)
    judged(program, UR5E, IN_SPACE, trajectory)
    kinds = [x.kind for x in trajectory.spans]
    assert kinds == ["rapid", "contour", "rapid", "rapid", "rapid", "contour", "rapid"]
    # The joints stay in the configuration that they are in.
    q = trajectory(np.linspace(0, trajectory.duration, 500))
    assert np.abs(q - q[0]).max() < 1.0


@pytest.mark.parametrize("method", ["paper", "conventional"])
def test_the_other_methods_also_plan_programs(method):
    events = Event(name="a", s=0.013), Event(name="b", s=0.06, lead_time=0.05)
    program = plane(SQUARE, Contour(path=BEND, events=events), process=Process(switch=Switch()))
    trajectory = ac.plan(program, PMK3S, IN_PLANE.replace(speed=0.05), TIMINGS[method]())
    assert trajectory.method == method
    if method == "paper":
        begins = [x.t[0] for x in trajectory.spans]
        np.testing.assert_allclose(trajectory(begins, 1), 0, atol=1e-9)
    seams = trajectory.starts[1:-1]
    np.testing.assert_allclose(trajectory(seams, side="left"), trajectory(seams), atol=1e-9)
    assert len(trajectory.events) == 6
    for event in trajectory.events:
        position = PMK3S.tool_position(trajectory(event.due))
        work = [x for x in trajectory.spans if x.work]
        number = next(k for k, x in enumerate(work) if x.s[0] <= event.s <= x.s[1])
        s = event.s - work[number].s[0]
        # Between its knots "paper" leaves the path; along it the tool is at the place.
        tangent = program.contours[number].path(s, 1, side="left" if s else "right")
        assert abs((position - event.point) @ tangent) < 1e-9
        assert np.linalg.norm(position - event.point) < 1e-4
    b = next(x for x in trajectory.events if x.name == "b")
    assert b.t == pytest.approx(b.due - 0.05, abs=1e-15)


def test_events_are_advanced_by_exactly_their_lead_time():
    s = (0.03, 0.02, 0.03, 0.03, 0.02)
    early = (0, 0, 0.25, -0.25, 0.1)
    events = tuple(
        Event(name=name, s=s, lead_time=t) for name, s, t in zip("abcde", s, early, strict=True)
    )
    timed_events = ac.plan(program_of(Contour(path=BEND, events=events)), PMK3S, IN_PLANE).events
    t, due = ({x.name: getattr(x, name) for x in timed_events} for name in ("t", "due"))
    assert due["a"] == due["c"] == due["d"]
    expected = {"a": due["a"], "c": due["c"] - 0.25, "d": due["d"] + 0.25, "e": due["b"] - 0.1}
    assert {name: t[name] for name in expected} == pytest.approx(expected, abs=1e-12)
    # As far after the end as a contour takes it.
    shifted = Contour(path=BEND, events=(Event(name="x", s=0.1 + 0.9e-9),))
    (timed_events,) = ac.plan(program_of(shifted), PMK3S, IN_PLANE).events
    np.testing.assert_allclose(timed_events.point, BEND(0.1), atol=1e-9)


def test_events_off_the_contour_before_the_motion_or_out_of_order_are_refused(refuses):
    for event, words, data in (
        (Event(name="x", s=0.0, lead_time=0.1), "0.1 s before the motion begins", {}),
    ):
        program = program_of(Contour(path=BEND, name="E7", events=(event,)))
        refuses(lambda x=program: ac.plan(x, PMK3S, IN_PLANE), InvalidInput, words, **data)
    # A dwell gives time to what leads.
    (timed,) = ac.plan(program_of(Dwell(duration=0.15), *program.moves), PMK3S, IN_PLANE).events
    assert (timed.t, timed.due) == pytest.approx((0.05, 0.15), abs=1e-12)
    process = Process(dwell=0.4, switch=Switch(on_lead=0.4))
    planned = ac.plan(ac.prepare(program_of(BEND), process), PMK3S, IN_PLANE)
    assert [x.kind for x in planned.spans] == ["dwell", "contour"]
    first = planned.events[0]
    assert (first.t, first.due) == pytest.approx((0.0, 0.4), abs=1e-12)
    dashes = program_of(*(Path.polyline([(x, 0.1), (x + 0.004, 0.1)]) for x in (0.30, 0.32)))

    def planned(lead):
        switch = Switch(name="glue", off_lead=lead)
        process = Process(lead_in=Lead(length=2e-3), switch=switch)
        return ac.plan(ac.prepare(dashes, process), PMK3S, PMK3S.limits.replace(speed=0.05))

    trajectory = planned(0.01)
    assert [x.value for x in trajectory.events] == [True, False, True, False]
    # So early that the tool would go off before it goes on.
    spacing = trajectory.events[1].due - trajectory.events[0].due
    refuses(lambda: planned(1.1 * spacing), InvalidInput, "before the previous event")


@pytest.mark.parametrize("arm", [PMK3S, UR5E], ids=lambda x: x.name)
def test_free_rapids_alternate_between_the_limits_of_the_joints(arm):
    paths = (SQUARE, BEND) if arm is PMK3S else (in_space(SQUARE), in_space(BEND))
    # Only joint acceleration and velocity bind, and rapids have no limits of the tool.
    acceleration = np.linspace(2.0, 3.0, arm.dof)
    fast = np.linspace(0.3, 0.4, arm.dof)
    limits = arm.limits.replace(
        speed=0.05,
        centripetal_acceleration=0.05,
        tool_acceleration=0.5,
        joint_torque=None,
        joint_acceleration=acceleration,
        joint_velocity=fast,
    )
    trajectory = ac.plan(program_of(*paths), arm, limits, ac.Optimal())
    (rapid,) = (x for x in trajectory.spans if x.kind == "rapid")
    begin, end = (trajectory(t) for t in rapid.t)
    way = np.abs(end - begin)
    moved = way > 0
    # Along the straight line the joint with the least share of its limits rules.
    rate, pull = (float((x[moved] / way[moved]).min()) for x in (fast, acceleration))
    # In shares of the way: up at `pull` to `rate` if there is room, and down again.
    shortest = 2 / np.sqrt(pull) if rate**2 / pull >= 1 else 1 / rate + rate / pull
    assert rapid.t[1] - rapid.t[0] == pytest.approx(shortest, rel=1e-3)
    t = np.linspace(*rapid.t, 50)
    share = (trajectory(t) - begin) @ (end - begin) / ((end - begin) @ (end - begin))
    np.testing.assert_allclose(trajectory(t), begin + share[:, None] * (end - begin), atol=1e-9)


@pytest.mark.parametrize("jerk", [None, 500.0])
def test_rapids_and_approaches_never_exceed_their_speeds(jerk):
    moves = [in_space(Path.polyline([[x, 0.1], [x, 0.14]])) for x in (0.3, 0.45)]
    between = Path.polyline([[0.35, -0.16, 0.1], [0.4, -0.16, 0.25], [0.5, -0.2, 0.1]])
    limits = UR5E.limits if jerk is None else UR5E.limits.replace(joint_jerk=jerk)
    free = Process(begin="drawn", approach=0.05, retract=0.05)
    slow = dataclasses.replace(free, rapid_speed=0.3, approach_speed=0.1)
    rng = np.random.default_rng(3)
    for drawn in (program_of(*moves), program_of(moves[0], Rapid(path=between), moves[1])):
        speeds = {}
        for process in (free, slow):
            plan = ac.plan(ac.prepare(drawn, process), UR5E, limits.replace(speed=0.1))
            peak_speeds = speeds[process] = []
            for span in plan.spans:
                if span.kind != "rapid":
                    continue
                t = np.sort(rng.uniform(0, span.trajectory.duration, 4000))
                q, dq = span.trajectory.motion(t, 1)
                peak_speeds.append(float(np.linalg.norm(UR5E.tool_velocity(q, dq), axis=1).max()))
        long = [x > 0.3 for x in speeds[free]]
        short = [x for x, y in zip(speeds[slow], long, strict=True) if not y]
        assert len(long) == len(speeds[slow]) and any(long)
        # The speed is reached, and never exceeded.
        assert max(speeds[slow]) == pytest.approx(0.3, rel=2e-3) and max(speeds[slow]) <= 0.3
        assert short == pytest.approx([0.1] * len(short), rel=1e-6) and max(short) <= 0.1 + 1e-12


def test_the_reserve_applies_to_rapids():
    second = Path.polyline([[0.35, 0.25], [0.3, 0.25]])
    spans = ac.plan(program_of(BEND, Rapid(), second), PMK3S, IN_PLANE).spans
    assert [x.kind for x in spans] == ["contour", "contour"]  # they meet
    configuration = PMK3S.configuration_of(ac.plan(TWO, PMK3S, IN_PLANE)(0.0))
    alone = [
        ac.plan(x, PMK3S, IN_PLANE, ac.Optimal(configuration=configuration)).duration
        for x in (BEND, SQUARE)
    ]
    ratios = []
    progress_log = []
    for reserve in (0.0, 0.4):
        trajectory = ac.plan(
            TWO, PMK3S, IN_PLANE, ac.Optimal(reserve=reserve), progress=progress_log.append
        )
        for span in trajectory.spans:
            use = ac.check(span.trajectory, PMK3S, PMK3S.limits)["joint_acceleration"].ratio
            assert use <= 1 - reserve + 1e-6
            if span.kind == "rapid":
                ratios.append(use)
        if not reserve:
            times = [np.ptp(x.t) for x in trajectory.contour_spans]
            assert times == pytest.approx(alone, rel=1e-9)
    assert ratios == pytest.approx([1.0, 0.6], abs=1e-3)
    assert (
        progress_log
        == [
            Step(("timing",), 0.5, "contour 1 of 2"),
            Step(("timing",), 1.0, "contour 2 of 2"),
        ]
        * 2
    )


def test_errors_name_the_contour_or_the_rapid(refuses):
    far = Contour(path=Path.polyline([[0.5, 0.2], [0.6, 0.2]]), name="E7")
    over = Rapid(path=Path.polyline([[0.35, 0.25], [0.5, 0.5], [0.3, 0.1]]))
    arc = Path(segments=[Arc(start=[0.3, 0.2], center=[0.3, 0.22], angle=1.0)])
    for moves, kind, words in (
        ((BEND, far), Unreachable, "contour 2 (E7):"),
        ((BEND, over, SQUARE), Unreachable, "rapid to contour 2:"),
        ((BEND, over), Unreachable, "rapid away from contour 1:"),
    ):
        refuses(lambda x=moves: ac.plan(program_of(*x), PMK3S, IN_PLANE), kind, words)
    alone = program_of(Contour(path=arc, name="E8"))
    refuses(lambda: ac.plan(alone, PMK3S, IN_PLANE, ac.Paper()), NotRealizable, "contour 1 (E8):")
    # Options of one path hold for a program of one only.
    options = {"start_speed": 0.02, "end_speed": 0.01}
    for name, x in options.items():
        refuses(
            lambda x={name: x}: ac.plan(TWO, PMK3S, IN_PLANE, ac.Optimal(**x)), InvalidInput, name
        )
    trajectory = ac.plan(program_of(BEND), PMK3S, IN_PLANE, ac.Optimal(**options))
    assert trajectory.duration == ac.plan(BEND, PMK3S, IN_PLANE, ac.Optimal(**options)).duration
    np.testing.assert_allclose(trajectory.speed_at([0.0, BEND.length], side="left")[1], 0.01)
    np.testing.assert_allclose(trajectory.s(0.0, 1), 0.02)


between = st.sampled_from(
    [(), (Rapid(),), (Dwell(duration=0.05),), (Event(name="m"),), (Event(name="m"), Rapid())]
)
shapes = st.sampled_from(["line", "arc"])
sides = st.sampled_from(["left", "right"])
leads = st.none() | st.builds(Lead, length=st.floats(1e-3, 0.02), shape=shapes, side=sides)


@pytest.mark.parametrize("axis_only", [False, True])
def test_a_rapid_turns_the_tool_by_half_a_turn_unless_it_is_free_to_turn(axis_only):
    """A line, a rapid, and a line back, with the tool following both."""
    lines = ([[0.4, 0, 0.2], [0.45, 0, 0.2]], [[0.45, 0.01, 0.2], [0.4, 0.01, 0.2]])
    first, second = (
        Path.polyline(x).following_tangent([0, 0, 1], axis_only=axis_only) for x in lines
    )
    over = Path.polyline([[0.45, 0, 0.2], [0.45, 0, 0.22], [0.45, 0.01, 0.22], [0.45, 0.01, 0.2]])
    trajectory = ac.plan(program_of(first, Rapid(path=over), second), UR5E, IN_SPACE)
    # No motion on the spot before or after it.
    assert [x.kind for x in trajectory.spans] == ["contour", "rapid", "contour"]
    turned = np.ptp(trajectory(np.linspace(*trajectory.spans[1].t, 50)), axis=0)
    assert (turned.max() < 0.2) == axis_only


def test_configuration_is_chosen_for_fastest_whole_program():
    # The speed of the tool bounds both contours; the way between them depends on the posture.
    program = ac.round_corners(program_of(in_space(SQUARE), in_space(BEND, 0.3)), tolerance=1e-3)
    limits = IN_SPACE.replace(speed=0.02, joint_torque=np.inf)
    equals = next(trace_by_duration(program.contours[0].path, UR5E, limits))
    assert len(equals) > 1
    durations = [ac.plan(program, UR5E, limits, ac.Optimal(seed=x(0.0))).duration for x in equals]
    assert max(durations) > 1.001 * min(durations)
    trajectory = ac.plan(program, UR5E, limits)
    assert trajectory.duration == pytest.approx(min(durations), rel=1e-6)


def test_an_approach_does_not_choose_another_configuration_than_the_contour():
    square = np.pad(SQUARE.vertices + [0.2, 0.1], ((0, 0), (0, 1)), constant_values=0.3)
    drawn = program_of(Path.polyline(square).pointing([0, 0, -1]))
    alone = ac.plan(drawn, UR5E, IN_SPACE)
    led = ac.plan(ac.prepare(drawn, Process(begin="drawn", approach=0.03)), UR5E, IN_SPACE)
    approach, contour = led.spans
    assert (approach.kind, contour.kind) == ("rapid", "contour")
    assert contour.t[1] - contour.t[0] == pytest.approx(alone.duration, rel=1e-3)
    np.testing.assert_allclose(led(contour.t[0]), alone(0.0), atol=0.1)


def test_the_tool_pierces_at_rest_above_the_waste_and_the_process_is_on_from_then_on():
    lead = Lead(length=8e-3, shape="arc", active=True)
    height = 3e-3
    process = Process(
        lead_in=lead,
        lead_out=lead,
        pierce=Pierce(time=0.3, height=height),
        approach=0.01,
        retract=0.01,
        dwell=0.1,
        switch=Switch(name="laser", on_lead=0.02),
    )
    program = plane(in_space(SQUARE), in_space(SQUARE, z=0.12), process=process)
    plan = ac.plan(program, UR5E, IN_SPACE)
    judged(program, UR5E, IN_SPACE, plan)
    first = ["rapid", "dwell", "contour", "rapid"]
    assert [x.kind for x in plan.spans] == [*first, "rapid", *first]
    on = plan.events[::2]
    switch_off = plan.events[1::2]
    assert all(x.value is True for x in on) and all(x.value is False for x in switch_off)
    moves = zip(program.contours, plan.contour_spans, on, switch_off, strict=True)
    for contour, span, begin, end in moves:
        # Ready for 0.3 s at the height, and off where the tool leaves the waste again.
        assert begin.t == pytest.approx(span.t[0] - 0.32) and end.t == pytest.approx(span.t[1])
        pierced = UR5E.tool_position(plan(np.linspace(begin.t, span.t[0], 50)))
        np.testing.assert_allclose(pierced, np.tile(pierced[0], (50, 1)), atol=1e-9)
        tool = UR5E.tool_position(plan(np.linspace(*span.t, 4000)))
        assert pierced[0, 2] - tool[-1, 2] == pytest.approx(height)
        # Straight down and then along the level.
        high = tool[:, 2] > tool[-1, 2] + 1e-9
        np.testing.assert_allclose(tool[high, :2], pierced[0, :2] + 0 * tool[high, :2], atol=1e-9)
        # The pierce is next to the contour, at the distance of the quarter circle.
        nearest = contour.path(np.linspace(*contour.at_work, 4000))[:, :2] - pierced[0, :2]
        radius = lead.length / (np.pi / 2)
        assert np.linalg.norm(nearest, axis=1).min() == pytest.approx(radius, rel=1e-3)


@pytest.mark.parametrize("method", ["optimal", "paper", "conventional"])
def test_a_path_and_its_program_and_its_joint_path_have_the_same_plan(method):
    path = ac.round_corners(BEND, tolerance=1e-3)
    program = program_of(path)
    motions = (
        path,
        program,
        ac.trace(path, PMK3S, configuration="negative"),
        trace_program(program, PMK3S, IN_PLANE),
    )
    plans = [ac.plan(x, PMK3S, IN_PLANE, TIMINGS[method]()) for x in motions]
    t = np.linspace(0, plans[0].duration, 500)
    for x in plans:
        assert x.duration == plans[0].duration and x.path is path
        assert [y.name for y in x.stretches] == [y.name for y in plans[0].stretches]
        for order in (0, 1, 2):
            np.testing.assert_array_equal(x(t, order), plans[0](t, order))
        (span,) = x.spans
        assert span.t == span.work == (0.0, x.duration) and span.s == (0.0, path.length)


def test_a_traced_program_is_timed_again_without_tracing(monkeypatch, refuses):
    program = ac.prepare(program_of(SQUARE, BEND), AROUND)
    progress_log = []
    traced = trace_program(program, PMK3S, IN_PLANE, progress=progress_log.append)
    assert progress_log == [
        Step(("tracing",), 0.5, "contour 1 of 2"),
        Step(("tracing",), 1.0, "contour 2 of 2"),
    ]
    whole = ac.plan(program, PMK3S, IN_PLANE, ac.Optimal(reserve=0.2))
    tracing = sys.modules["armcontour.planning.program_tracing"]
    for name in ("trace_by_duration", "trace"):
        monkeypatch.setattr(tracing, name, None)
    again = ac.plan(traced, PMK3S, IN_PLANE, ac.Optimal(reserve=0.2))
    assert again.duration == whole.duration and again.events == whole.events
    assert [x.t for x in again.spans] == [x.t for x in whole.spans]
    narrow = IN_PLANE.replace(joint_upper=traced.joint_paths[0](0.0) + 0.01)
    refuses(lambda: ac.plan(traced, PMK3S, narrow), Unreachable, "contour 1:", "upper limit")
    refuses(lambda: ac.plan(traced, UR5E), InvalidInput, "2 joints", "6")
    refuses(
        lambda: ac.plan(traced, PMK3S, options=ac.Optimal(configuration="negative")),
        InvalidInput,
        "configuration",
    )
