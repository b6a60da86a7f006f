"""Exported URScript programs and templates, read by independent parsers."""

import dataclasses
import os
import re
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.files.tables import refusals

from armcontour.files.exports import (
    RosYamlFormat,
    SetPointTable,
    TemplateFormat,
    URScriptFormat,
)
from armcontour.files.exports.template import BUILT_IN
from armcontour.motion import TimedEvent

NUMBER = r"-?\d+\.\d+"
AXES = ", ".join(rf"A{k} ({NUMBER})" for k in range(1, 7))
SPTP = re.compile(rf"(SPTP|PTP) \{{{AXES}\}}")
TRIGGER = rf"TRIGGER WHEN PATH = 0 ONSTART DELAY = ({NUMBER}) DO \$OUT\[(\d+)\] = (TRUE|FALSE)"
MOVE = re.compile(
    rf"MoveAbsJ \[\[([^\]]*)\], \[9E9(?:, 9E9){{5}}\]\], "
    rf"(slow|v1000 \\T:=({NUMBER})), (\w+), tool0;"
)
# Comments of the events in the tables.
LABELS = ["tool=on", "gas=2.5", 'label="A, \\"b\\"; 7"', "tool=off", "tool=on"]


def export(table, tmp_path, template, *, stem="made", **options):
    file = tmp_path / f"{stem}.txt"
    TemplateFormat(template=template, **options).write(table, file)
    return file.read_text(encoding="utf-8")


def write_template(tmp_path, text):
    file = tmp_path / "house.j2"
    file.write_text(text, encoding="utf-8")
    return file


def check_events(text, table):
    """All events are in comments, in order."""
    printed_events = [(x, float(t)) for x, t in re.findall(rf"[;!] (.*) at ({NUMBER}) s", text)]
    assert printed_events == [(x, round(y.t, 6)) for x, y in zip(LABELS, table.events, strict=True)]


def with_counts(lines, start, condition):
    """Lines that satisfy the condition, each with the number of lines before it that begin so."""
    indices = [i for i, x in enumerate(lines) if condition(x)]
    return [(sum(x.startswith(start) for x in lines[:i]), lines[i]) for i in indices]


def test_a_kuka_program_has_all_points_and_times_and_events_in_order(table, tmp_path):
    exported = table(6, count=9)
    text = export(exported, tmp_path, "kuka", outputs={"tool": 17})
    lines = [x.strip() for x in text.splitlines()]
    assert lines[2] == "DEF made( )" and lines[-1] == "END" and "{{" not in text
    points = [(m[1], [float(x) for x in m.groups()[1:]]) for x in lines if (m := SPTP.match(x))]
    assert [kind for kind, _ in points] == ["PTP"] + ["SPTP"] * 8
    np.testing.assert_allclose([q for _, q in points], np.degrees(exported.q), rtol=0, atol=6e-7)
    parts = [float(x) for x in re.findall(rf"TIME_BLOCK PART = ({NUMBER})", text)]
    whole = float(re.findall(rf"TIME_BLOCK END = ({NUMBER})", text)[0])
    times = np.cumsum([0, *parts]) / 100 * whole
    np.testing.assert_allclose([*times, whole], exported.t, rtol=0, atol=1e-6)
    check_events(text, exported)
    # A trigger precedes the segment to which its time applies.
    assert re.findall(TRIGGER, text) == [("0.000", "17", "TRUE"), ("0.000", "17", "FALSE")]
    before = with_counts(lines, "SPTP", lambda x: re.match(TRIGGER, x))
    assert [n for n, _ in before] == [0, 3]
    assert lines[-4:-1] == ["WAIT SEC 0.013500", "; tool=on at 0.045500 s", "$OUT[17] = TRUE"]


def test_an_abb_program_has_all_points_and_times_and_events_in_order(table, tmp_path):
    exported = table(6, count=9)
    text = export(exported, tmp_path, "abb", outputs={"tool": "doTool"})
    lines = [x.strip() for x in text.splitlines()]
    assert lines[0] == "MODULE part_7" and lines[-1] == "ENDMODULE"
    moves = [m for x in lines if (m := MOVE.fullmatch(x))]
    q = [[float(x) for x in m[1].split(",")] for m in moves]
    np.testing.assert_allclose(q, np.degrees(exported.q), rtol=0, atol=6e-7)
    times = np.cumsum([0, *(float(m[3]) for m in moves[1:])])
    np.testing.assert_allclose(times, exported.t, rtol=0, atol=5e-6)
    assert [m[4] for m in moves] == ["fine", *["z1"] * 7, "fine"]
    check_events(text, exported)
    assert re.findall(r"SetDO (\w+), (\d);", text) == [("doTool", x) for x in "101"]
    assert lines[-5:-3] == ["WaitTime 0.013500;", "! tool=on at 0.045500 s"]


def test_analog_outputs_of_a_program_are_set_where_they_change(table, tmp_path):
    power = np.array([0.0, 0.2, 0.2, 0.6, 1.0, 1.0, 0.3, 0.3, 0.1])
    exported = dataclasses.replace(
        table(6, count=9, events=()), analog={"power": power, "gas": power}
    )
    changes = [0, 1, 3, 4, 6, 8]
    text = export(exported, tmp_path, "kuka", outputs={"power": 2})
    positions = with_counts(text.splitlines(), "SPTP ", lambda x: "$ANOUT[2] =" in x)
    assert [(n, float(x.split("= ")[-1])) for n, x in positions] == [(k, power[k]) for k in changes]
    assert "TRIGGER WHEN PATH = 0 ONSTART DELAY = 0.000 DO $ANOUT[2] = 0.600000\n" in text
    lines = [
        x.strip() for x in export(exported, tmp_path, "abb", outputs={"power": "aoP"}).splitlines()
    ]
    positions = with_counts(lines, "MoveAbsJ", lambda x: x.startswith("SetAO aoP, "))
    values = [(n - 1, float(x[len("SetAO aoP, ") : -1])) for n, x in positions]
    assert values == [(k, power[k]) for k in changes]
    high = dataclasses.replace(exported, analog={"power": 10 * power})
    outputs = [({"power": 2}, "power ... from -1 to 1")]
    refusals(lambda x: export(high, tmp_path, "kuka", outputs=x), outputs)
    assert "SetAO aoP, 10.000000;" in export(high, tmp_path, "abb", outputs={"power": "aoP"})


def test_built_in_templates_refuse_other_arms_and_outputs(table, tmp_path):
    names = "controller must be names of signals"
    numbers = "controller must be integers of at least 1"
    table_of = {
        "kuka": (1, numbers, [0, -1, "1] = TRUE"]),
        "abb": ("doGas", names, [1]),
    }
    assert set(BUILT_IN) == set(table_of)
    for name, (good, words, bad) in table_of.items():
        refusals(lambda x, n=name: export(table(x), tmp_path, n), [(2, f"{name}. ... 6 ... has 2")])
        outputs = [({"gas": good}, "the event gas"), *(({"tool": x}, words) for x in bad)]
        outputs += [({"tool": x}, "outputs of") for x in (1.5, True, None)]
        refusals(lambda x, n=name: export(table(6), tmp_path, n, outputs=x), outputs)
    assert "$OUT[3] =" in export(table(6), tmp_path, "kuka", outputs={"tool": np.int64(3)})
    taken = ("do;\nStop", "7th", "EndIf", 33 * "d")
    outputs = [({"tool": x}, "RAPID does not allow the signal name") for x in taken]
    refusals(lambda x: export(table(6), tmp_path, "abb", outputs=x), outputs)


def test_a_kuka_program_has_the_name_of_its_file(table, tmp_path):
    text = export(table(6), tmp_path, "kuka", stem="a_7" + 21 * "b")
    assert f"\nDEF a_7{21 * 'b'}( )\n" in text and "\n; part 7: " in text

    stems = ("7_holes", "a-b", 25 * "a", "EndSpline")
    bad = [(x, f"KRL does not allow the name {x}") for x in stems]
    refusals(lambda x: export(table(6), tmp_path, "kuka", stem=x), bad)


def test_an_abb_module_has_a_valid_rapid_name(table, tmp_path):
    for name, module in (
        ("7 holes", "m_7_holes"),
        ("ö", r"m___[0-9a-f]{6}"),
        ("Test", "m_Test"),
        ("a" * 33, "a{25}_[0-9a-f]{6}"),
    ):
        text = export(dataclasses.replace(table(6), name=name), tmp_path, "abb")
        about = f"  ! {name}: 9 points in 0.032000 s"
        first, second = text.splitlines()[:2]
        assert re.fullmatch(f"MODULE {module}", first) and second == about


def test_the_template_of_the_guide_writes_the_program_in_the_guide(table, tmp_path):
    guide = FilePath(__file__).parents[3] / "docs" / "guides" / "export.md"
    template = guide.read_text(encoding="utf-8").split("```jinja\n")[1].split("```")[0]
    exported = table(6, count=9)
    text = export(exported, tmp_path, write_template(tmp_path, template), outputs={"tool": 4})
    moves = [x.split()[1:] for x in text.splitlines() if x.startswith("MOVE")]
    degrees = [[float(x) for x in " ".join(x[1:]).split(",")] for x in moves]
    np.testing.assert_allclose(np.radians(degrees), exported.q, rtol=0, atol=1e-8)
    np.testing.assert_allclose([float(x[0]) for x in moves], exported.t * 1e3, rtol=0, atol=1e-9)
    assert re.findall("^OUT.*", text, re.M) == [f"OUT 4 {x}" for x in ("ON", "OFF", "ON")]


ALL = """\
{{ name }}|{{ file }}|{{ name|identifier }}|{{ joint_names|join('/') }}|{{ dof }}|{{ cycle }}|\
{{ duration }}|{{ start_time }}|{{ events|length }}|{{ outputs.tool }}
{% for p in points %}
{{ p.number }} {{ p.t }} {{ p.q|degrees|fixed(9) }} {{ p.q_deg|fixed(9) }} {{ p.dq|fixed(3) }} \
{{ p.ddq|times(1000)|fixed(1) }}\
{% for e in p.events %} {{ e.name }}:{{ e.value }}:{{ e.t|fixed(6) }}{% endfor %}

{% endfor %}
"""


def test_a_user_template_can_use_all_data_of_the_table(table, tmp_path):
    ddq = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])
    exported = dataclasses.replace(table(2, count=3), ddq=ddq, start_time=-0.008)
    text = export(exported, tmp_path, write_template(tmp_path, ALL), outputs={"tool": 4})
    first, *rows = (x for x in text.splitlines() if x)
    assert first == "part 7|made|part_7|axis_1/axis_2|2|0.004|0.008|-0.008|5|4"
    assert [x.split()[0] for x in rows] == ["1", "2", "3"]
    degrees = ", ".join(f"{x:.9f}" for x in np.degrees(exported.q[1]))
    assert rows[1].startswith(f"2 0.004 {degrees} {degrees} ")
    assert "300.0, 400.0" in rows[1] and "gas:2.5:0.005123" in rows[1]


WRONG = [
    ("one\ntwo\n{{ points[0].speed }}\n", "house.j2, line 3: ... speed"),
    ("one\n\n{{ nothing }}", "house.j2, line 3: ... 'nothing' is undefined"),
    ("one\n{{ ''.__class__.__mro__ }}", "house.j2, line 2: ... unsafe"),
    ("{{ outputs.update({'a': 1}) }}", "house.j2, line 1: ... unsafe"),
    ("{{ 1|nofilter }}", "house.j2, line 1: ... nofilter"),
    ("{{ refuse('only on Sundays') }}", "house.j2: only on Sundays"),
]


def test_an_error_in_a_template_is_reported_with_its_line(table, tmp_path):
    refusals(lambda x: export(table(), tmp_path, write_template(tmp_path, x)), WRONG)


def test_missing_templates_are_refused(table, tmp_path):
    os.mkfifo(tmp_path / "pipe.j2")
    places = [
        (tmp_path / "no.j2", "There is no template"),
        (tmp_path / "pipe.j2", "not a regular file"),
        ("a" * 5000, "There is no template"),
    ]
    refusals(lambda x: export(table(), tmp_path, x), places)


@pytest.mark.parametrize("how", ["include", "import", "extends"])
def test_a_template_reads_no_other_files(table, tmp_path, how):
    (tmp_path / "head.j2").write_text("HEAD")
    file = tmp_path / "main.j2"
    end = " as x" if how == "import" else ""
    file.write_text(f"{{% {how} 'head.j2'{end} %}}")
    refusals(lambda x: export(table(), tmp_path, x), [(file, "main.j2, line 1")])


SERVOJ = re.compile(r"servoj\(\[([^\]]*)\], 0, 0, ([\d.]+), lookahead, gain\)")
MOVEJ = re.compile(r"movej\(\[([^\]]*)\], a=0.3, v=0.2\)")
OUTPUT = re.compile(r"set_standard_digital_out\((\d), (True|False)\)")
ANALOG = re.compile(r"set_standard_analog_out\(([01]), (\d\.\d{4})\)")
TEXT = re.compile(r'textmsg\("([^"]*)"\)')


def replay(text):
    """Simulate the program; return set-points and events with times, and the first position."""
    # The rule for programs over a socket: the first line begins the function, the last one ends it.
    first_line, *_, last_line = text.splitlines()
    assert re.fullmatch(r"def armcontour_\w{1,20}\(\):", first_line) and last_line == "end"
    lines = [x.split("#")[0].strip() for x in text.splitlines()]
    lines = [x for x in lines if x]
    assert sum(x.startswith("def ") for x in lines) == lines.count("end") == 1
    clock = 0.0
    points = []
    events = []
    first = np.zeros(0)
    for line in lines[1:-1]:
        if match := SERVOJ.fullmatch(line):
            points.append((clock, [float(x) for x in match[1].split(",")]))
            clock += float(match[2])
        elif match := MOVEJ.fullmatch(line):
            assert not points
            first = np.array([float(x) for x in match[1].split(",")])
        elif match := OUTPUT.fullmatch(line):
            events.append((clock, (int(match[1]), match[2] == "True")))
        elif match := ANALOG.fullmatch(line):
            events.append((clock, (f"AO{match[1]}", float(match[2]))))
        elif match := TEXT.fullmatch(line):
            events.append((clock, match[1]))
        else:
            assert line in ("lookahead = 0.1", "gain = 300", "stopj(2.0)"), line
    return points, events, first


def program(table, tmp_path, **options):
    URScriptFormat(**options).write(table, tmp_path / "a.script")
    return (tmp_path / "a.script").read_text(encoding="utf-8")


@given(
    st.integers(1, 12),
    st.lists(st.floats(0.0, 0.08), max_size=8),
    st.sampled_from([0.002, 0.004, 0.008]),
)
def test_exported_events_are_within_half_an_interval(tmp_path_factory, count, times, cycle):
    q = np.arange(6.0 * count).reshape(count, 6)
    t = np.arange(count) * cycle
    events = tuple(x for time in times for x in timed_events("tool", True, time))
    table = SetPointTable(
        name="any", joint_names=tuple("abcdef"), cycle=cycle, t=t, q=q, events=events
    )
    points, outputs, _ = replay(program(table, tmp_path_factory.mktemp("any"), outputs={"tool": 0}))
    event_times = [x for x, _ in outputs]
    assert len(event_times) == len(times)
    np.testing.assert_allclose(event_times, sorted(times), rtol=0, atol=cycle / 2 + 1e-9)
    np.testing.assert_array_equal([x for _, x in points[:count]], q)
    np.testing.assert_allclose([x for x, _ in points[:count]], t, atol=1e-12)
    assert all(x == q[-1].tolist() for _, x in points[count:])


def test_analog_outputs_are_set_at_the_set_points_where_they_change(table, tmp_path):
    power = np.array([0.0, 0.2, 0.2, 0.60004, 1.0, 1.0, 0.3, 0.0, 0.0])
    exported = dataclasses.replace(table(count=9, events=()), analog={"power": power})
    for output in ("AO1", 1):
        points, events, _ = replay(program(exported, tmp_path, outputs={"power": output}))
        assert events == [
            (pytest.approx(exported.t[k]), ("AO1", round(power[k], 4))) for k in (0, 1, 3, 4, 6, 7)
        ]
        assert len(points) == 10
    assert "analog" not in program(exported, tmp_path)
    wrong = [(x, "AO0 or AO1") for x in ("AO2", 2, "ao", -1)]
    refusals(lambda x: program(exported, tmp_path, outputs={"power": x}), wrong)
    high = dataclasses.replace(exported, analog={"power": 1000 * power})
    refusals(
        lambda x: program(x, tmp_path, outputs={"power": 0}), [(high, "power ... 1000 ... to 1")]
    )


def timed_events(name, value, t=0.0):
    return (TimedEvent(name=name, value=value, t=t, due=t, s=0.0, point=(0.0, 0.0)),)


def test_motions_that_the_program_cannot_express_are_refused(table, tmp_path):
    cases = [
        ((table(2), {}), "6 joints, but 'part 7' has 2"),
        ((dataclasses.replace(table(), cycle=0.001), {}), "multiple of 2 ms"),
        ((table(), {"outputs": {"tool": 8}}), "from 0 to 7"),
        ((table(), {"outputs": {"tool": "doTool"}}), "must be a number"),
        ((table(), {"outputs": {"gas": 1}}), "only the values on and off"),
        ((table(events=timed_events("a\\b", 1.0)), {}), "backslashes"),
        ((table(events=timed_events("a", 'the "b"')), {}), "without quotes"),
    ]
    refusals(lambda x: program(x[0], tmp_path, **x[1]), cases)
    assert not list(tmp_path.iterdir())


def on_rail(table):
    return dataclasses.replace(table(7, count=5), prismatic=(True, *[False] * 6))


def test_prismatic_joints_are_external_axes_in_mm(table, tmp_path):
    exported = on_rail(table)
    turned = np.degrees(exported.q[:, 1:])
    slid = 1e3 * exported.q[:, 0]
    kuka = re.findall(rf"S?PTP \{{{AXES}, E1 ({NUMBER})\}}", export(exported, tmp_path, "kuka"))
    np.testing.assert_allclose(
        np.array(kuka, float), np.column_stack([turned, slid]), rtol=0, atol=6e-7
    )
    text = export(exported, tmp_path, "abb")
    abb = re.findall(rf"MoveAbsJ \[\[([^\]]*)\], \[({NUMBER})(?:, 9E9){{5}}\]\]", text)
    values = [[*map(float, x.split(", ")), float(y)] for x, y in abb]
    np.testing.assert_allclose(values, np.column_stack([turned, slid]), rtol=0, atol=6e-7)
    # The headers say which axis of the controller is which joint, and in which unit.
    rail, *arm = exported.joint_names
    krl = export(exported, tmp_path, "kuka").splitlines()
    assert f"; Joints A1 to A6 in deg: {', '.join(arm)}" in krl
    assert f"; External axes: E1 {rail} (mm)" in krl
    assert f"  ! Joints rax_1 to rax_6 in deg: {', '.join(arm)}" in text.splitlines()
    assert f"  ! External axes: eax_a {rail} (mm)" in text.splitlines()
    units = ", ".join([f"{rail} [m]", *(f"{x} [rad]" for x in arm)])
    RosYamlFormat().write(exported, tmp_path / "made.yaml")
    lines = (tmp_path / "made.yaml").read_text(encoding="utf-8").splitlines()
    assert f"# Positions: {units}" in lines[:2]
    gantry = dataclasses.replace(table(6), prismatic=(True, *[False] * 5))
    for name in ("kuka", "abb"):
        refusals(lambda x: export(gantry, tmp_path, x), [(name, "6 revolute ... has 5 and 1")])
    writes = [(tmp_path / "made.script", "URScript cannot move external axes")]
    refusals(lambda x: URScriptFormat().write(gantry, x), writes)
