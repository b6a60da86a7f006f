"""Exports to tables: formats, decimals, events, and reading the files again."""

import dataclasses
import io
import json
import re
import warnings

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rosbags.typesys import Stores, get_typestore
from scipy.interpolate import BPoly, CubicHermiteSpline, CubicSpline
from tests.files.tables import refusals

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import read_trajectory
from armcontour.files.exports import (
    CsvFormat,
    RosYamlFormat,
    TemplateFormat,
    URScriptFormat,
    export,
    make_table,
)
from armcontour.files.exports import export_table as table_module
from armcontour.files.exports.export_table import csv_pieces, event_data
from armcontour.files.exports.formats import ENDINGS
from armcontour.motion import TimedEvent
from armcontour.motion.set_point_rule import make_rule

CYCLE = 0.004
JERK = 7.2  # rad/s³


def joined(samples, orders):
    """What a controller makes of points: cubics of two orders, quintics of three."""
    given_of = np.stack([samples.q, samples.dq, samples.ddq][:orders], axis=1)
    return BPoly.from_derivatives(samples.t, given_of)


def test_times_of_rows_and_events_count_from_the_first_set_point(set_points):
    data = set_points(np.zeros((30, 2)), start_time=-3 * CYCLE)
    exported = make_table(data, name="x")
    assert exported.t[0] == 0 and exported.start_time == -3 * CYCLE
    np.testing.assert_allclose(exported.t + exported.start_time, data.t, rtol=0, atol=1e-15)
    for before, after in zip(data.trajectory.events, exported.events, strict=True):
        assert after.t == pytest.approx(before.t + 3 * CYCLE, abs=1e-15)
        assert after.due == pytest.approx(before.due + 3 * CYCLE, abs=1e-15)
        assert (after.name, after.value, after.s) == (before.name, before.value, before.s)


def test_exported_trajectories_have_exact_derivatives(conventional, arm):
    sampled = make_table(conventional, name="x", arm=arm, cycle=0.05)
    np.testing.assert_array_equal(sampled.q, conventional(sampled.t))
    np.testing.assert_array_equal(sampled.dq, conventional(sampled.t, 1))
    np.testing.assert_array_equal(sampled.ddq, conventional(sampled.t, 2))
    assert sampled.t[-1] == conventional.duration and sampled.joint_names == arm.joint_names


@given(seed=st.integers(0, 10_000), count=st.integers(2, 40))
def test_cubic_and_quintic_controllers_run_the_same_curve_through_all_set_points(
    conventional, seed, count
):
    q = np.random.default_rng(seed).normal(size=(count, 2))
    data = ac.SetPoints(cycle=CYCLE, q=q, trajectory=conventional, method="none")
    exported = make_table(data, name="x")
    t = np.linspace(0, exported.t[-1], 501)
    np.testing.assert_allclose(joined(exported, 2)(t), joined(exported, 3)(t), atol=1e-11)
    np.testing.assert_allclose(joined(exported, 3)(exported.t), q, atol=1e-12)
    assert not exported.dq[[0, -1]].any()


@pytest.fixture(scope="module")
def smooth():
    path = ac.Path(segments=[ac.Arc(start=(0.40, 0.25), center=(0.35, 0.25), angle=1.0)])
    return ac.plan(path, ac.load_arm("pmk3s"), ac.Limits(joint_acceleration=0.72, joint_jerk=JERK))


def test_points_of_a_jerk_limited_plan_satisfy_the_limit_between_points(smooth, tmp_path):
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    set_points = ac.compensate(smooth, servo, ac.NoCompensation(), cycle=CYCLE)
    for data, cycle in ((smooth, CYCLE), (set_points, None)):
        exported = make_table(data, name="x", cycle=cycle)
        times = np.minimum(exported.t, smooth.duration)
        np.testing.assert_allclose(exported.dq, smooth(times, 1), atol=1e-12)
        np.testing.assert_allclose(exported.ddq, smooth(times, 2), atol=1e-12)
        steps = np.abs(np.diff(exported.ddq, axis=0)) / np.diff(exported.t)[:, None]
        assert 0.99 * JERK < steps.max() <= JERK * (1 + 1e-9)
        assert np.abs(exported.ddq[[0, -1]]).max() < 1e-12
        # Between points, a controller of quintics is within a nanoradian of the plan.
        dense = np.linspace(0, smooth.duration, 3001)
        np.testing.assert_allclose(joined(exported, 3)(dense), smooth(dense), atol=1e-9)
        RosYamlFormat().write(exported, tmp_path / "a.yaml")
        again = read_trajectory(tmp_path / "a.yaml", exported.joint_names)
        np.testing.assert_allclose(again.ddq, exported.ddq, atol=0.51e-7)
    # Where it is to join points by cubics, velocities are those of the spline, as before.
    exported = make_table(set_points, name="x", derivatives=1)
    spline = CubicSpline(set_points.t, set_points.q, bc_type="clamped")
    np.testing.assert_allclose(exported.dq, spline(set_points.t, 1), atol=1e-12)


def test_an_event_belongs_to_the_last_point_at_or_before_it(table, set_points):
    exported = table(count=9)
    assert exported.point_of_events == [0, 1, 1, 3, 8]
    assert exported.events[3].t < exported.t[3]  # by rounding only, so that it is on the point
    # An event before the plan is kept where the command leads.
    data = set_points(np.zeros((9, 2)), start_time=-0.008, events=early(-0.005))
    assert make_table(data, name="x").events[0].t == pytest.approx(0.003, abs=1e-15)


def early(t):
    return (TimedEvent(name="gas", value=True, t=t, due=0.0, s=0.0, point=(0.0, 0.0)),)


def test_invalid_tables_are_refused(set_points, conventional, arm):
    data = set_points(np.zeros((3, 2)))
    three = set_points(np.zeros((3, 3)))
    too_early = set_points(np.zeros((3, 2)), events=early(-0.05))
    table = [
        ((data, {"cycle": 0.008}), "have a cycle of 0.004 s"),
        ((three, {"arm": arm}), "has 2 joints, but the motion of 'x' has 3"),
        ((data, {"joint_names": ["a", "b" * 81]}), "81 characters, more than 80"),
        (([1, 2], {}), "must be a SetPoints or a Trajectory"),
        ((too_early, {}), "0.05 s before the first set-point"),
    ]
    refusals(lambda x: make_table(x[0], name="x", **x[1]), table)


EVENT = re.compile(r'(?P<name>\w+)=(?P<value>on|off|[-\d.e]+|"(?:[^"\\]|\\.)*")@(?P<t>[\d.]+)')
QUANTITIES = (("q", "rad", 0), ("dq", "rad/s", 1), ("ddq", "rad/s^2", 2))


def half_digit(decimals):
    return 0.5000001 * 10.0**-decimals


def assert_columns(columns, table, decimals):
    np.testing.assert_allclose(columns["t [s]"], table.t, rtol=0, atol=1e-12)
    for quantity, unit, fewer in QUANTITIES:
        atol = half_digit(decimals - fewer)
        for i, name in enumerate(table.joint_names):
            values = columns[f"{quantity} {name} [{unit}]"]
            expected = getattr(table, quantity)[:, i]
            np.testing.assert_allclose(values, expected, rtol=0, atol=atol, err_msg=name)


def events_in(cell):
    words = {"on": True, "off": False}
    return [
        (x["name"], words[x["value"]] if x["value"] in words else json.loads(x["value"]), x["t"])
        for x in EVENT.finditer(cell)
    ]


@pytest.mark.parametrize("dof", [2, 7])
def test_pandas_reads_an_exported_csv_file(table, tmp_path, dof):
    exported = table(dof)
    for decimals, cycle in ((7, 0.008), (9, 0.001), (12, CYCLE), (9, CYCLE)):
        rule = make_rule(ac.Limits(), dof) if decimals == 12 else None
        exported = dataclasses.replace(exported, t=np.arange(9) * cycle, cycle=cycle, rule=rule)
        CsvFormat().write(exported, tmp_path / "a.csv")
        columns = pd.read_csv(tmp_path / "a.csv")
        assert len(columns.columns) == 1 + 3 * dof + 1
        assert_columns(columns, exported, decimals)
        number = (tmp_path / "a.csv").read_text().splitlines()[1].split(",")[1]
        assert len(number.partition(".")[2]) == decimals
    cells = columns["events"].fillna("")
    microseconds = [abs(x.t * 1e6 - round(x.t * 1e6)) < 1e-4 for x in exported.events]
    assert microseconds == [True, False, False, True, True]
    digits = [6 if x else 9 for x in microseconds]
    expected = [
        (x.name, x.value, f"{x.t:.{n}f}") for x, n in zip(exported.events, digits, strict=True)
    ]
    assert [x for cell in cells for x in events_in(cell)] == expected
    assert [i for i, cell in enumerate(cells) for _ in events_in(cell)] == exported.point_of_events


def csv_text(header, columns):
    return "".join(csv_pieces(header, columns))


def by_numpy(header, rows):
    file = io.StringIO()
    file.write(",".join(header) + "\n")
    np.savetxt(file, rows, fmt="%.12f", delimiter=",")
    return file.getvalue()


@given(
    arrays(
        np.float64,
        st.tuples(st.integers(0, 12), st.integers(1, 5)),
        elements=st.floats(-1e18, 1e18, allow_subnormal=True),
    )
)
def test_csv_text_equals_that_of_numpy(rows):
    header = ["t [s]", *(f"joint {i} [rad]" for i in range(rows.shape[1]))]
    assert csv_text(header, [rows]) == by_numpy(header, rows)


def test_csv_text_of_many_blocks_equals_that_of_one_block(monkeypatch):
    monkeypatch.setattr(table_module, "FORMAT_BLOCK", 30)
    for count in (9, 10, 11, 30):
        rows = np.random.default_rng(0).normal(size=(count, 3))
        text = csv_text(["a", "b", "c"], [rows[:, 0], rows[:, 1:]])
        assert text == by_numpy(["a", "b", "c"], rows)
    # A comma in a name does not make a column.
    text = csv_text(["t [s]", 'wrist, "left" [rad]'], [np.zeros(1), np.zeros(1)])
    assert text.splitlines()[0] == 't [s],"wrist, ""left"" [rad]"'


ARRAYS = {"positions": "q", "velocities": "dq", "accelerations": "ddq"}


def ros_yaml(table, file):
    RosYamlFormat().write(table, file)
    text = file.read_text(encoding="utf-8")
    documents = list(yaml.safe_load_all(text))
    assert len(documents) == 1  # `ros2 topic pub --yaml-file` sends every document
    return documents[0], text


def test_exported_yaml_is_a_joint_trajectory_message(table, tmp_path):
    types = get_typestore(Stores.ROS2_HUMBLE).types
    point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
    fields = {x.name for x in dataclasses.fields(point)} - {"__msgtype__"}
    for dof in (2, 6):
        original = table(dof)
        message, text = ros_yaml(original, tmp_path / "a.yaml")
        assert list(message) == ["header", "joint_names", "points"]
        assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
        assert message["joint_names"] == list(original.joint_names)
        for fewer, (key, name) in enumerate(ARRAYS.items()):
            values = [x[key] for x in message["points"]]
            atol = half_digit(7 - fewer)
            np.testing.assert_allclose(values, getattr(original, name), rtol=0, atol=atol)
        starts = [x["time_from_start"] for x in message["points"]]
        assert [x["sec"] * 10**9 + x["nanosec"] for x in starts] == [4000_000 * i for i in range(9)]
        assert all(x["effort"] == [] and set(x) == fields for x in message["points"])
        mark = "# event: "
        lines = [x.removeprefix(mark) for x in text.splitlines() if x.startswith(mark)]
        assert [json.loads(x) for x in lines] == [event_data(x) for x in original.events]


def test_times_beyond_the_range_of_ros_are_refused(table, tmp_path):
    words = {1e-10: "at least 1 ns apart", 3e9: "at most 2147483647 s"}

    def write(t):
        original = dataclasses.replace(table(count=3, events=()), t=np.sort([0, 1, t]))
        RosYamlFormat().write(original, tmp_path / "a")

    refusals(write, words.items())
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def rounded():
    """Compensated set-points of corners, whose accelerations jump, and of a smooth plan."""
    path = ac.Path.polyline([(0.30, 0.20), (0.36, 0.20), (0.36, 0.26)])
    arm = ac.load_arm("pmk3s")
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    plans = [
        ac.plan(ac.round_corners(path, tolerance=1e-3), arm, ac.Limits(joint_acceleration=0.72)),
        ac.plan(path, arm, ac.Limits(joint_acceleration=0.72, joint_jerk=JERK)),
    ]
    options = ac.Inverse(command_limits=ac.Limits(joint_acceleration=0.72))
    return [ac.compensate(x, servo, options, cycle=CYCLE) for x in plans]


@pytest.mark.filterwarnings("ignore:.*exported accelerations:UserWarning")
@pytest.mark.parametrize("derivatives", [0, 1, 2])
@pytest.mark.parametrize("tolerance", [2e-5, 3e-4])
def test_a_reduced_export_stays_within_the_tolerance_between_points(
    rounded, tmp_path, derivatives, tolerance
):
    for data in rounded:
        whole = make_table(data, name="x", derivatives=derivatives)
        form = RosYamlFormat(points=len(whole.t) - 1, point_tolerance=tolerance)
        export(data, tmp_path / "a.yaml", dataclasses.replace(form, derivatives=derivatives))
        few = read_trajectory(tmp_path / "a.yaml", whole.joint_names)
        assert few.t[0] == 0 and few.t[-1] == pytest.approx(whole.t[-1], abs=1e-9)
        assert len(few.t) < 0.6 * len(whole.t)
        # Linear, cubic and quintic interpolation by SciPy, of all points and of these.
        dense = np.linspace(0, few.t[-1], 20 * len(whole.t))
        curves = []
        for x in (whole, few):
            if derivatives == 0:
                values = np.stack([np.interp(dense, x.t, q) for q in x.q.T], axis=1)
            elif derivatives == 1:
                values = CubicHermiteSpline(x.t, x.q, x.dq)(dense)
            else:
                values = joined(x, 3)(dense)
            curves.append(values)
        errors = np.abs(curves[0] - curves[1]).max()
        assert errors <= tolerance + 1e-12
        # Points are not wasted: with three quarters of them, the tolerance is out of reach.
        fewer = dataclasses.replace(form, points=len(few.t) * 3 // 4, derivatives=derivatives)
        with pytest.raises(InvalidInput, match=f"requires {len(few.t)} points") as refused:
            export(data, tmp_path / "b.yaml", fewer)
        # The named figure can be reached.
        reached = refused.value.needed
        assert reached > tolerance
        enough = dataclasses.replace(fewer, point_tolerance=float(f"{reached * 1.005:.3g}"))
        assert len(enough.select(whole).t) <= fewer.points


PLAIN = {"csv": CsvFormat, "ros-yaml": RosYamlFormat, "urscript": URScriptFormat}


@pytest.fixture
def six(set_points):
    events = set_points(np.zeros((1, 1))).trajectory.events
    return set_points(
        np.random.default_rng(0).normal(size=(20, 6)),
        events=tuple(x for x in events if x.name != "label"),
    )


def bytes_of(place):
    files = [place] if place.is_file() else sorted(place.rglob("*"))
    return {x.name: x.read_bytes() for x in files if x.is_file()}


@pytest.mark.filterwarnings("ignore:.*does not switch ")
def test_exported_bytes_depend_only_on_format_and_data(six, tmp_path):
    for kind, form in PLAIN.items():
        first, second = (tmp_path / f"{x}{kind}" / f"part{ENDINGS[kind]}" for x in "ab")
        for place in (first, second):
            place.parent.mkdir()
        export(six, first)
        export(six, str(second), form())
        assert bytes_of(first) and bytes_of(first) == bytes_of(second)
        # Once more, over what is there.
        export(six, first)
        assert bytes_of(first) == bytes_of(second)
        assert [x.name for x in first.parent.iterdir()] == [first.name]


@pytest.fixture(scope="module")
def line_of_six():
    """A plan of an arm with six joints."""
    path = ac.Path.line((0.45, -0.05, 0.3), (0.5, -0.05, 0.3)).pointing((0, 0, -1))
    arm = ac.load_arm("ur5e")
    return ac.plan(path, arm, arm.limits.replace(speed=0.25))


def test_a_warning_names_events_without_an_output_once(set_points, line_of_six, tmp_path):
    kuka = TemplateFormat(template="kuka", outputs={"tool": 17})
    abb = TemplateFormat(template="abb", outputs={"tool": "doTool"})
    events = set_points(np.zeros((20, 6))).trajectory.events
    plan = dataclasses.replace(line_of_six, events=events)
    with pytest.warns(UserWarning, match="does not switch gas,"):
        export(plan, tmp_path / "part.src", kuka)
    assert "DEF part( )" in (tmp_path / "part.src").read_text()
    switches = tuple(x for x in events if x.name == "tool")
    switching = dataclasses.replace(line_of_six, events=switches)
    place = tmp_path / "part.txt"
    bare = (TemplateFormat(template=x) for x in ("kuka", "abb"))
    for form in (*bare, URScriptFormat()):
        with pytest.warns(UserWarning, match="does not switch tool,") as caught:
            export(switching, place, form)
        assert len(caught) == 1 and caught[0].filename == __file__
    # Values that these programs cannot switch.
    with pytest.warns(UserWarning, match="gas, label, because the values are not on or off"):
        export(plan, place, abb)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export(switching, place, abb)
        export(switching, tmp_path / "part.csv")


@pytest.mark.parametrize("ending", [".src", ".script"])
def test_programs_that_do_not_set_an_analog_output_warn(line_of_six, tmp_path, ending):
    form = URScriptFormat() if ending == ".script" else TemplateFormat(template="kuka")
    form = dataclasses.replace(form, analog={"power": lambda t: 0 * t})
    with pytest.warns(UserWarning, match="does not set power"):
        export(line_of_six, tmp_path / f"part{ending}", form)
    form = dataclasses.replace(form, outputs={"power": 1})
    export(line_of_six, tmp_path / f"part{ending}", form)
    assert re.search(r"ANOUT\[1\]|analog_out\(1,", (tmp_path / f"part{ending}").read_text())


def test_unknown_formats_and_invalid_options_are_refused(six, tmp_path):
    cases = [
        ("a.txt", {}, "The extension of a.txt does not belong to a format"),
        ("a.csv", {"format": "xml"}, "There is no format"),
        ("a.csv", {"joint_names": "abcdef"}, "joint_names must be a list"),
        ("no/a.csv", {}, "No such file or directory"),
        (
            "a.script",
            {"format": URScriptFormat(outputs={"tol": 1})},
            "outputs ... 'tol'",
        ),
    ]
    refusals(lambda x: export(six, tmp_path / x[0], **x[1]), [((a, b), c) for a, b, c in cases])
    wrong = [
        (lambda: URScriptFormat(outputs=["tool"]), "must be a mapping"),
        (lambda: CsvFormat(derivatives=3), "derivatives ... from 0 to 2"),
        (lambda: RosYamlFormat(outputs={"tool": 0}), "no argument 'outputs'"),
        (lambda: TemplateFormat(), "argument: 'template'"),
    ]
    refusals(lambda x: x(), wrong)
    assert not list(tmp_path.iterdir())
    with pytest.warns(UserWarning, match="gas, because the values are not on or off"):
        export(six, tmp_path / "a.script", URScriptFormat(outputs={"tool": 1}))
    export(six, tmp_path / "a.csv", joint_names=np.array(list("abcdef")))


def test_a_failed_writer_leaves_the_earlier_file(six, tmp_path, monkeypatch):
    place = tmp_path / "part.csv"
    export(six, place)
    before = bytes_of(place)

    def halfway(self, table, path):
        self.written(table, path)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(CsvFormat, "written", CsvFormat.__dict__["write"], raising=False)
    monkeypatch.setattr(CsvFormat, "write", halfway)
    words = "Cannot write  ... No space left on device; free "
    places = [(place, words), (tmp_path / "new.csv", words)]
    refusals(lambda x: export(six, x), places)
    assert bytes_of(place) == before
    assert [x.name for x in tmp_path.iterdir()] == [place.name]
