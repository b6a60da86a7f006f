"""Exports in several files, and what else a controller needs: tolerances, torques, contours."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader
from tests.dynamics_extra import needs_dynamics
from tests.files.tables import refusals

import armcontour as ac
from armcontour.files import read_trajectory
from armcontour.files.exports import (
    CsvFormat,
    GoalTolerances,
    McapFormat,
    RosYamlFormat,
    SetPointTable,
    TemplateFormat,
    URScriptFormat,
    export,
    make_table,
    predict_tolerances,
)
from armcontour.files.exports.file_parts import POINTS_PER_FILE, describe_parts, split_table
from armcontour.motion import TimedEvent

CYCLE = 0.004
# Set-points in motion and at rest, in turn.
MOVES = st.lists(st.tuples(st.integers(1, 30), st.integers(1, 6)), min_size=1, max_size=6)


def stop_and_go(moves, dof=2):
    """A table that moves for some intervals and rests for some, again and again."""
    steps = np.concatenate([np.repeat([1.0, 0.0], x) for x in moves])
    q = np.append(0.0, np.cumsum(0.01 * steps))[:, None] * np.arange(1, dof + 1)
    t = np.arange(len(q)) * CYCLE
    dq = np.gradient(q, CYCLE, axis=0)
    events = tuple(
        TimedEvent(name="tool", value=bool(i % 2), t=x, due=x, s=0.0, point=(0.0, 0.0))
        for i, x in enumerate(np.linspace(0, t[-1], 7))
    )
    return SetPointTable(
        name="part",
        joint_names=tuple(f"axis_{i}" for i in range(dof)),
        cycle=CYCLE,
        t=t,
        q=q,
        dq=dq,
        ddq=np.gradient(dq, CYCLE, axis=0),
        events=events,
        start_time=-0.012,
        analog={"power": t},
        contours=((0.0, "a"), (float(t[-1]) / 2, "b")),
    )


@given(moves=MOVES, most=st.integers(2, 40), in_motion=st.booleans())
def test_files_join_to_the_table_and_end_where_the_motion_rests(moves, most, in_motion):
    table = stop_and_go(moves)
    parts = split_table(table, most, in_motion=in_motion)
    np.testing.assert_array_equal(
        np.concatenate([parts[0].q, *(x.q[1:] for x in parts[1:])]), table.q
    )
    starts = [x.start_time - table.start_time for x in parts]
    times = [a + x.t[1:] for a, x in zip(starts, parts, strict=True)]
    np.testing.assert_allclose(np.concatenate([[0.0], *times]), table.t, atol=1e-12)
    for before, after in zip(parts[:-1], parts[1:], strict=True):
        np.testing.assert_array_equal(before.q[-1], after.q[0])
        assert after.t[0] == 0 and len(after.t) >= 2
    for of, at in (
        (lambda x: [e.t for e in x.events], [x.t for x in table.events]),
        (lambda x: [t for t, _ in x.contours], [t for t, _ in table.contours]),
    ):
        pairs = zip(starts, parts, strict=True)
        found = [start + t for start, part in pairs for t in of(part)]
        np.testing.assert_allclose(found, at, atol=1e-9)
    assert [x for part in parts for x in part.analog["power"][1:]] == list(table.t[1:])
    still = np.abs(np.diff(table.q[:, 0])) == 0
    for part, start in zip(parts[:-1], starts, strict=False):
        i = round(start / CYCLE) + len(part.t) - 1
        assert part.ends_at_rest == (still[i - 1] and still[i])
        if part.ends_at_rest:
            assert not part.dq[-1].any() and not part.ddq[-1].any()
        if in_motion or len(part.t) <= most:
            assert len(part.t) <= most
    if not in_motion:
        assert all(x.ends_at_rest for x in parts)
        # A file is longer only if the motion does not rest within it.
        for part in parts:
            rests = np.abs(np.diff(part.q[:, 0])) == 0
            assert len(part.t) <= most or not (rests[1 : most - 1] & rests[: most - 2]).any()


def test_files_are_named_in_order_and_say_which_they_are(tmp_path, set_points):
    data = set_points(np.tile(stop_and_go([(40, 3)] * 6).q[:, :1], 6), events=())
    forms = {
        "a.yaml": RosYamlFormat(points_per_file=50),
        "a.script": URScriptFormat(points_per_file=50),
        "a.src": TemplateFormat(template="kuka", points_per_file=50),
        "a.mod": TemplateFormat(template="abb", points_per_file=50),
        "a.mcap": McapFormat(points_per_file=50),
        "a.csv": CsvFormat(points_per_file=60, comments=True),
    }
    for name, form in forms.items():
        folder = tmp_path / name
        folder.mkdir()
        if name == "a.csv":
            with pytest.warns(UserWarning, match="end in motion"):
                export(data, folder / "never.csv", CsvFormat(points_per_file=20))
            for file in folder.iterdir():
                file.unlink()
        export(data, folder / name, form)
        stem, _, ending = name.partition(".")
        names = [f"{stem}_{k:02}.{ending}" for k in range(1, 7)]
        assert sorted(x.name for x in folder.iterdir()) == names
        if name != "a.mcap":
            text = (folder / names[1]).read_text()
            assert "a, file 2 of 6" in text
    assert "def armcontour_a_2():" in (tmp_path / "a.script" / "a_02.script").read_text()
    assert (tmp_path / "a.mod" / "a_02.mod").read_text().startswith("MODULE a_2\n")
    assert "DEF a_02( )" in (tmp_path / "a.src" / "a_02.src").read_text()
    # One file keeps its name.
    export(data, tmp_path / "b.yaml", RosYamlFormat(points_per_file=5000))
    assert (tmp_path / "b.yaml").exists()


def test_a_motion_without_rests_gives_a_longer_file_and_a_warning(tmp_path, set_points):
    data = set_points(np.tile(np.linspace(0, 1, 300)[:, None], 6), events=())
    with pytest.warns(
        UserWarning, match="more than 200 points, up to 300, because a file must end"
    ):
        export(data, tmp_path / "a.yaml", RosYamlFormat(points_per_file="motoros2"))
    assert (tmp_path / "a.yaml").exists()
    table = make_table(data, name="a")
    assert describe_parts(split_table(table, 300, in_motion=False), 300) == []
    bad = [(x, "points_per_file must be an integer") for x in (1, 0, -3, "kuka")]
    bad += [(True, "points_per_file"), (2.5, "points_per_file")]
    refusals(lambda x: RosYamlFormat(points_per_file=x), bad)
    assert POINTS_PER_FILE["motoros2"] == 200


def test_the_plan_is_also_divided_where_it_stops_for_a_moment(tmp_path):
    arm = ac.load_arm("pmk3s")
    lines = [[(0.40, 0.25), (0.42, 0.25)], [(0.42, 0.26), (0.40, 0.26)]]
    moves = tuple(
        ac.Contour(path=ac.Path.polyline(x), name=f"line {k}") for k, x in enumerate(lines, 1)
    )
    plan = ac.plan(ac.Program(moves=moves), arm, ac.Limits(joint_acceleration=0.72))
    ends = np.array([x.t[1] for x in plan.spans])
    for at_stops, cycle in ((False, CYCLE), (True, CYCLE), (True, 0.05)):
        table = make_table(plan, name="a", arm=arm, cycle=cycle, at_stops=at_stops)
        parts = split_table(table, len(table.t) // 2, in_motion=False)
        assert len(parts) > 1 and all(x.ends_at_rest for x in parts)
        assert 0.25 * cycle * (1 - 1e-9) <= np.diff(table.t)[:-1].min()
        assert np.diff(table.t).max() <= 1.25 * cycle * (1 + 1e-9)
        for part in parts[1:]:
            away = np.abs(ends - part.start_time).min()
            assert away <= (1e-9 if at_stops else cycle / 2 + 1e-9)
            # To stop there, no joint needs more than the limit.
            assert np.abs(np.diff(part.q[:2], axis=0)).max() / np.diff(part.t[:2]) ** 2 <= 0.72
    table = make_table(plan, name="a", arm=arm)
    RosYamlFormat().write(table, tmp_path / "a.yaml")
    marks = [x for x in (tmp_path / "a.yaml").read_text().splitlines() if "# contour" in x]
    assert [yaml.safe_load(x.removeprefix("# contour: "))["name"] for x in marks] == [
        "line 1",
        "line 2",
    ]
    six = dataclasses.replace(
        table, q=np.tile(table.q, 3), dq=None, ddq=None, tool=None, joint_names=tuple("abcdef")
    )
    for template, sign in (("kuka", ";"), ("abb", "!")):
        TemplateFormat(template=template).write(six, tmp_path / "a.txt")
        found = [x.strip() for x in (tmp_path / "a.txt").read_text().splitlines()]
        said = [f"{sign} contour {name} from {t:.6f} s" for t, name in table.contours]
        assert [x for x in found if x.startswith(f"{sign} contour")] == said


@pytest.fixture(scope="module")
def executed():
    arm = ac.load_arm("pmk3s")
    path = ac.Path.polyline([(0.40, 0.25), (0.42, 0.25)])
    plan = ac.plan(path, arm, ac.Limits(joint_acceleration=0.72))
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    set_points = ac.compensate(plan, servo, ac.NoCompensation(), cycle=CYCLE)
    return ac.simulate(set_points, ac.ServoPlant(arm=arm, servo=servo))


def test_tolerances_are_a_multiple_of_the_predicted_errors(executed, tmp_path):
    found = predict_tolerances(executed, 2.5)
    commands = executed.set_points
    dense = np.linspace(0, commands.t[-1], 4001)
    command, measured = (
        np.column_stack([np.interp(dense, x.t, q) for q in x.q.T]) for x in (commands, executed)
    )
    lag = np.abs(command - measured).max(axis=0)
    assert lag.max() > 1e-3
    np.testing.assert_allclose(found.path, 2.5 * lag, rtol=0.01)
    # The motion is simulated until it rests at the last set-point.
    assert (found.goal == 1e-3).all() and found.time >= 0.5
    place = tmp_path / "goal.yaml"
    export(commands, place, RosYamlFormat(tolerances=found), joint_names=["a", "b"])
    goal = yaml.safe_load(place.read_text())
    assert set(goal) == {"trajectory", "path_tolerance", "goal_tolerance", "goal_time_tolerance"}
    for key, values in (("path_tolerance", found.path), ("goal_tolerance", found.goal)):
        assert [x["name"] for x in goal[key]] == ["a", "b"]
        np.testing.assert_allclose([x["position"] for x in goal[key]], values, atol=1e-6)
        assert all(x["velocity"] == x["acceleration"] == 0 for x in goal[key])
    late = goal["goal_time_tolerance"]
    assert late["sec"] + late["nanosec"] * 1e-9 == pytest.approx(found.time, abs=1e-9)
    again = read_trajectory(place, ["a", "b"])
    np.testing.assert_allclose(again.q, commands.q, atol=0.51e-7)
    bad = [(0.5, "factor must be at least 1"), (float("nan"), "factor")]
    refusals(lambda x: predict_tolerances(executed, x), bad)
    three = GoalTolerances(path=np.ones(3), goal=np.ones(3))
    refusals(
        lambda x: export(commands, place, RosYamlFormat(tolerances=x)), [(three, "3 joints ... 2")]
    )


@needs_dynamics
def test_torques_are_those_of_the_plan(tmp_path):
    arm = ac.load_arm("ur5e")
    start = np.array([0.2, -1.7, -2.0, -0.8, 1.6, 0.3])
    plan = ac.plan(ac.JointPath.spline([start, start + 0.2]), arm)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    data = ac.compensate(plan, servo, cycle=CYCLE)
    at = data.t
    torque = arm.torque(*(plan.with_rests(at, order) for order in range(3)))
    export(data, tmp_path / "a.csv", CsvFormat(effort=True), arm=arm)
    found = pd.read_csv(tmp_path / "a.csv")
    columns = [f"torque {x} [N m]" for x in arm.joint_names]
    np.testing.assert_allclose(found[columns], torque, atol=0.51e-4)
    assert not read_trajectory(tmp_path / "a.csv", arm.joint_names).left_out
    export(data, tmp_path / "a.yaml", RosYamlFormat(effort=True), arm=arm)
    points = yaml.safe_load((tmp_path / "a.yaml").read_text())["points"]
    np.testing.assert_allclose([x["effort"] for x in points], torque, atol=0.51e-4)
    assert np.abs([x["velocities"] for x in points]).max() > 0.1
    export(data, tmp_path / "a.mcap", McapFormat(effort=True), arm=arm)
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        ((kind, _, raw),) = reader.messages()
        message = reader.deserialize(raw, kind.msgtype)
    np.testing.assert_allclose([x.effort for x in message.points], torque, atol=1e-12)
    bad = [(None, "torques ... Specify arm"), (ac.load_arm("pmk3s"), "joints")]
    refusals(lambda x: export(data, tmp_path / "b.csv", CsvFormat(effort=True), arm=x), bad)
