"""Message frames of plans and executions."""

import copy
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from tests.studio.conftest import PAPER
from tests.studio.session_pages import figure

from armcontour.core import render
from armcontour.core.errors import Collision, ExecutionError, Unreachable
from armcontour.core.render import LIMITS
from armcontour.files import parse_job
from armcontour.jobs import run
from armcontour.report.message_frame import TYPES, MessageFrame
from armcontour.studio.execution_frame import execution_frame
from armcontour.studio.plan_frames import (
    NO_LIMIT,
    Tier,
    drawing_frame,
    picture_frame,
    refusal_header,
)
from armcontour.studio.preview import CoarsePlanner
from armcontour.verification import check, evaluate


def packed(frame):
    """The frame as the page receives it."""
    return MessageFrame.unpack(frame.pack())


def uv(view, points):
    """Coordinates in the drawing plane, which is the x-y plane here."""
    return points[..., :2] - view.plane.origin[:2]


@pytest.fixture(scope="module")
def shown(plans, view):
    return plans["optimal"], packed(picture_frame(plans["optimal"], view))


@pytest.fixture(scope="module")
def gasket(gasket_plan, view):
    return gasket_plan, packed(picture_frame(gasket_plan, view))


def near(actual, expected, within):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=within)


def test_points_are_on_the_path_with_their_times_and_speeds(shown, view):
    planned, frame = shown
    s = frame.arrays["path_s"].astype(float)
    a = frame.arrays
    path = planned.path.path
    trajectory = planned.trajectory
    inside = np.clip(s, 0, path.length)
    near(a["path"] + view.centre, uv(view, path(inside)), 1e-7)
    near(a["xyz"][:, :2], path(inside), 1e-7)
    # Near rests, small differences of s are large ones of t.
    times = np.clip(a["path_t"].astype(float), 0, trajectory.duration)
    near(trajectory.s(times), inside, 1e-6)
    near(a["speed"], trajectory.speed_at(inside), 2e-4)
    assert (a["assigned"] == np.float32(0.15)).all()
    assert figure(frame.header, "duration") == trajectory.duration


def test_colours_are_those_of_the_explanation(shown):
    planned, frame = shown
    bindings = planned.explanation.bindings
    a = frame.arrays
    random = np.random.default_rng(3).uniform(0, planned.path.length, 200)
    names = [x["name"] for x in frame.header["limits"]]
    drawn = a["path_s"].astype(float)
    # Except where 32 bits do not resolve the side of a change.
    edges = np.array([x.s[0] for x in bindings])
    close = np.abs(random[:, None] - edges).min(axis=1) < 1e-6
    assert close.sum() < 20
    for s in random[~close]:
        (why,) = (x.name for x in bindings if x.s[0] <= s < x.s[1])
        k = a["binding"][np.searchsorted(drawn, s, side="right") - 1]
        assert (names[k] if k != NO_LIMIT else "nothing") == why
    kinds = {x["name"]: x["kind"] for x in frame.header["limits"]}
    assert kinds["joint 2 acceleration"] == "acceleration"
    assert kinds["assigned velocity"] == "assigned velocity"
    assert set(kinds.values()) <= set(LIMITS)
    assert frame.header["time"] == list(map(list, render.cells(planned.explanation.time_table)))
    kinds = [x["kind"] for x in frame.header["kinds"]]
    assert kinds[0] == "acceleration" and set(kinds) <= {x.kind for x in planned.explanation.shares}


def test_charts_show_the_use_of_the_limits(shown, gasket):
    planned, frame = shown
    a = frame.arrays
    limits = planned.run.limits
    assert (np.diff(a["t"]) >= 0).all() and a["t"][0] == 0
    assert a["q"].dtype == np.float64
    use = check(planned.trajectory, planned.job.arm, limits)["joint_acceleration"]
    assert np.abs(a["usage_a"]).max() == pytest.approx(use.ratio, abs=1e-3)
    middle = len(a["t"]) // 2
    near(a["q"][middle], planned.trajectory(float(a["t"][middle])), 1e-5)
    assert (a["usage_a"].min(axis=0) < 0).all()
    for planned, frame in (shown, gasket):
        is_limited = planned.run.limits.joint_torque is not None
        assert ("usage_torque" in frame.arrays) == is_limited


def test_rapids_have_the_speed_of_the_tool(gasket):
    planned, frame = gasket
    a = frame.arrays
    rapids = [x.t for x in planned.trajectory.spans if x.kind == "rapid"]
    assert len(a["rapid_most"]) == len(rapids) > 2

    def speed(t):
        """Central differences of the tool's position [m/s]."""
        step = 1e-5
        places = planned.trajectory(np.concatenate([t - step, t + step]))
        before, after = np.split(planned.job.arm.tool_position(places), 2)
        return np.linalg.norm(after - before, axis=1) / (2 * step)

    for k, (begin, end) in enumerate(rapids):
        first, last = a["rapid_breaks"][k : k + 2]
        times = a["rapid_t"][first:last].astype(float)
        assert times[0] == pytest.approx(begin) and times[-1] == pytest.approx(end)
        inner = slice(first + 1, last - 1)
        near(a["rapid_speed"][inner], speed(times[1:-1]), 2e-3)
        most = speed(np.linspace(begin, end, 2_000)[1:-1]).max()
        assert a["rapid_most"][k] == pytest.approx(most, rel=2e-3)
    # A rapid may be faster than the work.
    assert a["rapid_most"].max() > a["speed"].max()


def test_corners_and_shortfalls_have_their_positions(shown, gasket, view):
    planned, frame = shown
    corners = frame.header["corners"]
    assert [x["vertex"] for x in corners] == [1, 2]
    for x, point in zip(corners, planned.objective.path.vertices[1:3], strict=True):
        near(x["corner"], uv(view, point), 1e-12)
        gap = np.linalg.norm(np.subtract(x["apex"], x["corner"]))
        assert gap == pytest.approx(x["error"], rel=1e-9)
        assert x["allowed"] == pytest.approx(5e-3)
    assert len(frame.header["shortfalls"]) == len(planned.explanation.shortfalls) > 0
    for x in frame.header["shortfalls"]:
        near(x["uv"], uv(view, planned.path.path(x["s"])), 1e-12)
        assert x["t"] == pytest.approx(float(planned.trajectory.time_at(x["s"])))


def test_the_cut_is_half_of_the_kerf_from_the_drawn_contours(previewer, square, view):
    square["path"] = {"file": "gasket.dxf", "orientation": {"axis": [0, 0, -1]}}
    lead = {"length": "2 mm", "shape": "arc"}
    marks = {"MARK": {"kerf": None, "lead_in": None}}
    leads = {"lead_in": lead | {"active": True}, "lead_out": lead}
    square["process"] = {"kerf": "1 mm", "by_layer": marks, **leads}
    planned = previewer.plan(square)
    frame = packed(picture_frame(planned, view))
    a = frame.arrays
    cut = [x for x in planned.path.contours if x.layer == "CUT"]
    assert frame.header["kerfs"] == [1e-3] * len(cut)
    parts = np.split(a["cut"], a["cut_breaks"][1:-1])
    # Along the active lead-in, without the lead-out.
    for part, contour in zip(parts, cut, strict=True):
        ends = contour.path(np.array([0.0, contour.at_work[1]]))
        near(part[[0, -1]] + view.centre, uv(view, ends), 1e-7)
    drawn = np.split(a["drawn"], a["drawn_breaks"][1:-1])
    drawn_contours = [x for x in planned.job.program.contours if x.layer == "CUT"]
    for part, contour in zip(drawn, drawn_contours, strict=True):
        near(part[0], uv(view, contour.path(0.0)) - view.centre, 1e-7)
    assert "cut" not in packed(picture_frame(previewer.plan(PAPER, "optimal"), view)).arrays


def test_the_process_of_each_contour_is_drawn(previewer, square, view):
    """Numbers, names, pierces and parts with the process off; one contour has other settings."""
    square["path"] = {"file": "gasket.dxf", "orientation": {"axis": [0, 0, -1]}}
    lead = {"length": "2 mm"}
    tabs = {"count": 2, "width": "1 mm"}
    process = {"lead_in": lead, "lead_out": lead, "switch": {"name": "laser"}}
    square["process"] = process | {"order": "drawn"}
    others = [x["t"] for x in picture_frame(previewer.plan(square), view).header["contours"][:2]]
    square = copy.deepcopy(square)
    own = {"lead_in": None, "tabs": tabs, "pierce": {"time": "0.2 s"}, "order": 1}
    square["path"]["contours"] = {"CUT-1": own | {"speed": "20 mm/s"}}
    planned = previewer.plan(square)
    frame = packed(picture_frame(planned, view))
    contours = frame.header["contours"]
    assert [x["number"] for x in contours] == [1, 2, 4, 5, 6, 7, 8, 9, 10, 3]
    assert contours[-1]["name"] == "CUT-1" and contours[-1]["layer"] == "CUT"
    assert [x["number"] for x in contours if x["pierces"]] == [3]
    near([x["t"] for x in contours[:2]], others, 1e-12)
    *unchanged, mine = np.split(
        idle := frame.arrays["idle"], np.flatnonzero(np.diff(idle[:, 0])) + 1
    )
    ends = planned.path.breaks
    for k, rows in enumerate(unchanged):
        near(rows[:, 1:] - ends[k], np.add([[0, 0.002], np.diff(ends)[k] - [0.002, 0]], 0), 1e-6)
    starts, ends_of_parts = mine[:, 1:].T - ends[-2]
    near(ends_of_parts - starts, [0.001, 0.001, 0.002], 1e-6)
    assert ends_of_parts[-1] == pytest.approx(np.diff(ends)[-1], abs=1e-6) and starts[0] > 0.001
    begin, end = contours[-1]["t"]
    assert end - begin == np.ptp(planned.trajectory.contour_spans[-1].t)
    assert end - begin > np.diff(ends)[-1] / 0.02


def test_long_programs_are_drawn_before_they_are_planned(previewer, paper, view):
    k = np.arange(30_001)
    vertices = np.stack([0.3 + 1e-5 * k % 0.05, 0.2 + 0.01 * (k % 2)], axis=1)
    data = paper | {"path": {"points": vertices.tolist()}}
    assert previewer.is_long(data) and not previewer.is_long(paper)
    frame = packed(drawing_frame(previewer.path_program(data), view))
    points = frame.arrays["objective"]
    assert len(points) == len(vertices), "every corner is drawn"
    assert frame.header["rows"] == [] and frame.header["tier"] == "outline"
    for extreme in (np.min, np.max):
        near(extreme(points + view.centre, axis=0), extreme(uv(view, vertices), axis=0), 1e-7)


@pytest.fixture(scope="module")
def done(previewer_of_plans, plans, view):
    planned = plans["uncompensated"]
    planned = replace(planned, run=replace(planned.run, experiment=None))
    executed = previewer_of_plans.execute(planned)
    return executed, packed(execution_frame(executed, view))


def test_executed_frames_have_the_errors_and_offsets_of_an_evaluation(done, view):
    executed, frame = done
    evaluation = evaluate(executed.execution, executed.planned.path)
    e = evaluation.contour_error
    assert figure(frame.header, "contour_error.rms") == pytest.approx(e.rms, rel=1e-12)
    assert figure(frame.header, "contour_error.max") == pytest.approx(e.max, rel=1e-12)
    assert frame.arrays["error"].max() == pytest.approx(e.max, rel=1e-6)
    assert figure(frame.header, "settled") == executed.settled
    # All rows equal those of an evaluation.
    figures = {x["name"]: x for x in render.frame(evaluation.to_data())}
    for x in (y for y in frame.header["rows"] if y["name"] not in ("kept", "off_drawing")):
        assert x == figures[x["name"]] | {"value": pytest.approx(figures[x["name"]]["value"])}
    a = frame.arrays
    path = executed.planned.path.path
    execution = executed.execution
    tool = execution.tool[np.abs(execution.t - a["t"][:, None]).argmin(axis=1)]
    evaluation = a["base"] + view.centre + a["offset"]
    np.testing.assert_allclose(evaluation, uv(view, tool), rtol=0, atol=2e-7)
    np.testing.assert_allclose(
        np.linalg.norm(a["offset"], axis=1), a["error"], rtol=1e-4, atol=1e-12
    )
    # In space, the same deviation leads from the path to the tool.
    np.testing.assert_allclose((a["base_xyz"] + a["offset_xyz"])[:, :2], tool, rtol=0, atol=2e-7)
    np.testing.assert_allclose(
        np.linalg.norm(a["offset_xyz"], axis=1), a["error"], rtol=1e-4, atol=1e-12
    )
    assert path.project(a["base_xyz"][:, :2].astype(float)).distance.max() < 1e-7
    # The rounding of corners is a part of the distance from the drawing.
    drawn = executed.planned.objective.path.project(tool).distance
    assert a["off"].max() == pytest.approx(drawn.max(), rel=1e-3)
    assert a["off"].max() > a["error"].max()
    # The stated time is that of the largest distance.
    (k,) = np.flatnonzero(execution.t == frame.header["off_t"])
    at = executed.planned.objective.path.project(execution.tool[[k]]).distance
    assert at == pytest.approx(drawn.max(), rel=1e-6)
    base = a["base"] + view.centre + view.plane.origin[:2]
    assert path.project(base.astype(float)).distance.max() < 1e-7
    # Small errors have as many digits as large ones.
    t = a["t"].astype(float)
    k = int(np.argmin(np.where((t > 1) & (t < 4), a["error"], 1)))
    exact = executed.pieces[0].followed.distance[np.abs(executed.execution.t - t[k]).argmin()]
    assert a["error"][k] == pytest.approx(exact, rel=1e-4)


def test_the_time_of_the_largest_error_is_on_its_contour(previewer_of_plans, gasket_plan, view):
    executed = previewer_of_plans.execute(gasket_plan)
    off_t = execution_frame(executed, view).header["off_t"]
    execution = executed.execution
    found = {}
    spans = [x.t for x in gasket_plan.trajectory.contour_spans]
    for contour, (begin, end) in zip(gasket_plan.objective.contours, spans, strict=True):
        (on,) = np.nonzero((execution.t >= begin) & (execution.t <= end))
        distance = contour.path.project(execution.tool[on]).distance
        found[execution.t[on][distance.argmax()]] = distance.max()
    assert len(found) > 1
    assert found[off_t] == max(found.values())


def test_the_arm_is_also_animated_between_contours(previewer_of_plans, plans, gasket_plan, view):
    for planned in (plans["proposed"], gasket_plan):
        executed = previewer_of_plans.execute(planned)
        a = packed(execution_frame(executed, view)).arrays
        execution = executed.execution
        played = [np.interp(execution.t, a["pose_t"], q) for q in a["q"].T]
        np.testing.assert_allclose(np.transpose(played), execution.q, rtol=0, atol=1e-4)
        tool = execution.arm.tool_position(a["q"])
        np.testing.assert_allclose(a["xyz"][:, : tool.shape[1]], tool, rtol=0, atol=1e-7)


def test_refusals_state_the_position_of_the_cause(paper, plans, view):
    path = {"points": [[0.35, 0.1], [0.41, 0.15], [0.9, 0.3], [0.35, 0.35]]}
    with pytest.raises(Unreachable) as caught:
        CoarsePlanner().plan(paper | {"path": path}, "optimal")
    error = caught.value
    waypoints = uv(view, np.array(path["points"]))
    header = refusal_header(error, view, tier=1, run="optimal", waypoints=waypoints)
    assert header["sentence"] == str(error) and header["exit"] == 3
    assert (header["error"], header["tier"], header["run"]) == ("Unreachable", 1, "optimal")
    np.testing.assert_allclose(header["at"]["uv"], uv(view, np.array(error.point)))
    packed(MessageFrame("refusal", header))
    # At a waypoint, it is named.
    error = Unreachable("Too far.", point=(0.4, 0.2), s=0.3, joint=2)
    waypoints = uv(view, np.array([[0.1, 0.1], [0.4, 0.2]]))
    position = refusal_header(error, view, tier=1, waypoints=waypoints)["at"]
    assert (position["waypoint"], position["s"], position["joint"]) == (1, 0.3, 2)
    assert "waypoint" not in refusal_header(error, view, tier=1, waypoints=waypoints[:1])["at"]
    # A time has the place of the plan.
    planned = plans["optimal"]
    error = ExecutionError("It did not rest.", t=2.0, joint=1)
    tool = planned.job.arm.tool_position(planned.trajectory(2.0))
    position = refusal_header(error, view, tier=2, planned=planned)["at"]
    np.testing.assert_allclose(position["uv"], uv(view, tool))
    header = refusal_header(Collision("Somewhere."), view, tier=3)
    assert header["at"] == {} and header["exit"] == 8


arrays = st.dictionaries(
    st.text(max_size=5),
    st.sampled_from(TYPES).flatmap(
        lambda kind: hnp.arrays(kind, hnp.array_shapes(max_dims=2, min_side=0, max_side=7))
    ),
    max_size=4,
)


@given(arrays=arrays)
def test_unpacked_frames_equal_packed_frames(arrays):
    frame = MessageFrame("picture", {"text": "0,5 µm", "n": [1, None, True, 0.1]}, arrays)
    unpacked = MessageFrame.unpack(frame.pack())
    assert (unpacked.kind, unpacked.header) == (frame.kind, frame.header)
    assert unpacked.arrays.keys() == arrays.keys()
    for name, values in arrays.items():
        assert unpacked.arrays[name].dtype == values.dtype
        np.testing.assert_array_equal(unpacked.arrays[name], values)


def whole(data, name, cycle):
    """The result of a full run with another cycle."""
    data = copy.deepcopy(data)
    data["runs"] = {name: data["runs"][name]}
    data["runs"][name]["cycle"] = cycle
    return run(parse_job(yaml.safe_dump(data))).runs[name]


def exact(previewer, data, name):
    """The plan of a full run, as the task process draws it."""
    job = previewer.job(data, name)
    return previewer.shown(job, run(job).runs[name], Tier.EXACT)


class TestResults:
    @pytest.mark.parametrize("name", ["optimal", "proposed"])
    def test_the_numbers_shown_equal_those_of_a_run(self, previewer, paper, name):
        del paper["experiment"]
        paper["runs"][name]["cycle"] = 4e-3
        planned = exact(previewer, paper, name)
        executed = previewer.execute(planned)
        run_result = whole(paper, name, 4e-3)
        evaluation = run_result.evaluation
        duration = run_result.trajectory.duration
        assert planned.trajectory.duration == pytest.approx(duration, abs=1e-12)
        assert executed.settled == evaluation.settled
        assert executed.errors.rms == pytest.approx(evaluation.contour_error.rms, rel=1e-12)
        assert executed.errors.max == pytest.approx(evaluation.contour_error.max, rel=1e-12)
        bindings = None if run_result.explanation is None else run_result.explanation.bindings
        assert bindings == (planned.explanation and planned.explanation.bindings)

    def test_rigid_bodies_judge_set_points_of_inverse_dynamics(self, previewer, paper):
        job = previewer.job(paper, "inverse-dynamics")
        judged = run(job).runs["inverse-dynamics"].judged.contour_error
        executed = previewer.execute(previewer.plan(paper, "inverse-dynamics"))
        assert executed.errors.max < 3 * judged.max < 1e-5

    @pytest.mark.parametrize("method", ["inverse", "inverse_dynamics"])
    def test_the_worse_execution_determines_the_verdict(self, previewer, paper, view, method):
        paper["experiment"] = {"payload": {"mass": 1.0, "center": [0.0, 0.0, 0.0]}}
        paper["runs"] = {"one": {"cycle": 4e-3, "compensation": {"method": method}}}
        (result,) = run(parse_job(yaml.safe_dump(paper))).runs.values()
        executed = previewer.execute(exact(previewer, paper, "one"))
        frame = execution_frame(executed, view)
        rows = {x["name"]: x for x in frame.header["rows"]}
        for name in ("kept", "off_drawing"):
            row = result.to_data()[name]
            assert rows[name]["value"] == row.value
            # The preview omits simulations on which the verdict does not depend.
            assert row.note.startswith(rows[name]["note"])
        assert result.judged is result.experiment.evaluation
        assert figure(frame.header, "contour_error.max") == result.judged.contour_error.max


class TestCache:
    def test_earlier_results_are_cached_until_files_change(self, previewer, paper):
        for name in ("optimal", "proposed"):
            previewer.execute(previewer.plan(paper, name))
        planned = previewer.plan(paper, "optimal")
        assert previewer.plan(paper, "optimal").trajectory is planned.trajectory
        points = previewer.execute(planned).execution.set_points
        assert previewer.execute(planned).execution.set_points is points
        previewer.forget()
        assert previewer.plan(paper, "optimal").trajectory is not planned.trajectory


def test_the_arm_stays_in_its_configuration_after_an_edit(previewer, square):
    first = previewer.plan(square)
    square = square | {"limits": {"speed": 0.1}}
    second = previewer.plan(square)
    np.testing.assert_allclose(second.start, first.start, atol=1e-9)


def test_a_motion_of_minutes_is_planned_but_not_simulated(previewer, paper):
    paper["limits"]["speed"] = "1e-4 m/s"
    planned = previewer.plan(paper, "optimal")
    assert planned.trajectory.duration > 3000
    assert not previewer.may_execute(planned)


def test_refusals_and_slow_points_name_the_line_of_g_code(paper, view, tmp_path):
    """Moves of about 21 mm, whose corners are rounded by less than 1 mm."""
    x = 350 + 2.0 * np.arange(12)
    y = 100 + 21.0 * (np.arange(12) % 2)
    moves = [f"N{10 * k} G1 X{x[k]} Y{y[k]}" for k in range(1, 12)]
    program = "\n".join(["G21 G90 F30000", f"G0 X{x[0]} Y{y[0]}", *moves])
    (tmp_path / "part.ngc").write_text(program)
    planner = CoarsePlanner(tmp_path)
    data = paper | {"path": {"file": "part.ngc"}}
    planned = planner.plan(data, "optimal")
    shortfalls = picture_frame(planned, view).header["shortfalls"]
    assert len(shortfalls) > 3
    ends = np.cumsum(np.hypot(np.diff(x), np.diff(y))) * 1e-3
    for shortfall in shortfalls:
        # Half of the rounding of each corner shortens the path.
        s = shortfall["s"] * ends[-1] / planned.path.length
        near = np.searchsorted(ends, [s - 2e-3, s + 2e-3]).clip(0, 10)
        named = re.search(r", lines? ([0-9]+)(?: to ([0-9]+)|)", shortfall["sentence"])
        lines = {int(x) for x in named.groups() if x}
        assert lines & {3 + int(k) for k in near}
    (tmp_path / "part.ngc").write_text(program.replace(f"X{x[7]} ", "X1900 "))
    with pytest.raises(Unreachable) as caught:
        CoarsePlanner(tmp_path).plan(data, "optimal")
    assert "line 9 (N70)" in refusal_header(caught.value, view, tier=1)["sentence"]
