"""URScript, read back by a small interpreter of the few statements that are written."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.io.tables import refusals

from armcontour.io.exports import Table, write_table
from armcontour.motion import TimedEvent

SERVOJ = re.compile(r"servoj\(\[([^\]]*)\], 0, 0, ([\d.]+), lookahead, gain\)")
MOVEJ = re.compile(r"movej\(\[([^\]]*)\], a=0.3, v=0.2\)")
OUTPUT = re.compile(r"set_standard_digital_out\((\d), (True|False)\)")
ANALOG = re.compile(r"set_standard_analog_out\(([01]), (\d\.\d{4})\)")
TEXT = re.compile(r'textmsg\("([^"]*)"\)')


def run(text):
    """The set-points with their times, what was switched when, and where it began."""
    # The rule for programs over a socket: the first line begins the function, the last one ends it.
    first_line, *_, last_line = text.splitlines()
    assert re.fullmatch(r"def armcontour_\w+\(\):", first_line) and last_line == "end"
    lines = [x.split("#")[0].strip() for x in text.splitlines()]
    lines = [x for x in lines if x]
    assert sum(x.startswith("def ") for x in lines) == lines.count("end") == 1
    clock, points, events, first = 0.0, [], [], np.zeros(0)
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
    write_table(table, tmp_path / "a.script", format="urscript", **options)
    return (tmp_path / "a.script").read_text(encoding="utf-8")


def test_every_set_point_has_its_time_and_the_way_to_the_first_is_slow(table, tmp_path):
    given = table(count=30, events=())
    points, events, first = run(program(given, tmp_path))
    assert len(points) == len(given.q) + 1 and not events
    np.testing.assert_allclose([x for x, _ in points[:-1]], given.t, rtol=0, atol=1e-12)
    np.testing.assert_allclose([q for _, q in points[:-1]], given.q, rtol=0, atol=0.5000001e-6)
    np.testing.assert_allclose(points[-1][1], given.q[-1], rtol=0, atol=0.5000001e-6)
    np.testing.assert_allclose(first, given.q[0], rtol=0, atol=0.5000001e-6)


def test_events_come_within_half_an_interval_and_the_set_points_stay_in_order(table, tmp_path):
    given = table(count=9)
    label = dataclasses.replace(given.events[2], value="plain words")
    given = dataclasses.replace(given, events=(*given.events[:2], label, *given.events[3:]))
    text = program(given, tmp_path, outputs={"tool": 3})
    points, events, _ = run(text)
    names = [(3, True), "gas=2.5", "label=plain words", (3, False), (3, True)]
    assert [what for _, what in events] == names
    for (at, _), event in zip(events, given.events, strict=True):
        assert abs(at - event.t) <= given.period / 2 + 1e-12
    np.testing.assert_allclose([q for _, q in points[:9]], given.q, rtol=0, atol=0.5000001e-6)
    exact = [float(x) for x in re.findall(r"# .* at ([\d.]+) s", text)]
    np.testing.assert_allclose(exact, [x.t for x in given.events], rtol=0, atol=0.5000001e-6)


@given(
    st.integers(1, 12),
    st.lists(st.floats(0.0, 0.08), max_size=8),
    st.sampled_from([0.002, 0.004, 0.008]),
)
def test_any_events_come_in_order_within_half_an_interval(tmp_path_factory, count, times, period):
    q, t = np.arange(6.0 * count).reshape(count, 6), np.arange(count) * period
    events = tuple(x for at in times for x in said("tool", True, at))
    table = Table(name="any", joint_names=tuple("abcdef"), period=period, t=t, q=q, events=events)
    points, found, _ = run(program(table, tmp_path_factory.mktemp("any"), outputs={"tool": 0}))
    at = [x for x, _ in found]
    assert len(at) == len(times)
    np.testing.assert_allclose(at, sorted(times), rtol=0, atol=period / 2 + 1e-9)
    np.testing.assert_array_equal([x for _, x in points[:count]], q)
    np.testing.assert_allclose([x for x, _ in points[:count]], t, atol=1e-12)
    assert all(x == q[-1].tolist() for _, x in points[count:])


def test_a_name_without_quotes_and_backslashes_can_be_told(table, tmp_path):
    # Without outputs, switches are only told.
    switches = tuple(x for x in table().events if x.name == "tool")
    _, events, _ = run(program(table(events=switches), tmp_path))
    assert [x for _, x in events] == ["tool=on", "tool=off", "tool=on"]
    for name in ("a;b", "gas (N2)", "it's", "x,y", "Düse"):
        events = [x for value in (True, False, 2.5, "on") for x in said(name, value)]
        _, told, _ = run(program(table(events=tuple(events)), tmp_path))
        assert [x for _, x in told] == [f"{name}={x}" for x in ("on", "off", "2.5", "on")]


def test_analog_outputs_are_set_at_the_set_points_where_they_change(table, tmp_path):
    power = np.array([0.0, 0.2, 0.2, 0.60004, 1.0, 1.0, 0.3, 0.0, 0.0])
    given = dataclasses.replace(table(count=9, events=()), analog={"power": power})
    for output in ("AO1", 1):
        points, events, _ = run(program(given, tmp_path, outputs={"power": output}))
        assert events == [
            (pytest.approx(given.t[k]), ("AO1", round(power[k], 4))) for k in (0, 1, 3, 4, 6, 7)
        ]
        assert len(points) == 10
    assert "analog" not in program(given, tmp_path)
    wrong = [(x, "AO0 or AO1") for x in ("AO2", 2, "ao", True, -1)]
    refusals(lambda x: program(given, tmp_path, outputs={"power": x}), wrong)
    high = dataclasses.replace(given, analog={"power": 1000 * power})
    refusals(
        lambda x: program(x, tmp_path, outputs={"power": 0}), [(high, "power ... 1000 ... to 1")]
    )


def test_contours_are_named_where_they_begin_and_the_call_is_an_option(table, tmp_path):
    given = dataclasses.replace(table(count=9, events=()), name="7 Löcher")
    given = dataclasses.replace(given, contours=((0.0, "rim"), (given.t[4], "hole 2")))
    lines = program(given, tmp_path).splitlines()
    assert lines[0] == "def armcontour_7_L_cher():" and lines[-1] == "end"
    at = [i for i, x in enumerate(lines) if "# contour" in x]
    assert [sum("servoj" in x for x in lines[:i]) for i in at] == [0, 4]
    assert "  # contour hole 2" in lines
    called = program(given, tmp_path, call=True).splitlines()
    assert called == [*lines, "", "armcontour_7_L_cher()"]


def said(name, value, t=0.0):
    return (TimedEvent(name=name, value=value, t=t, due=t, s=0.0, point=(0.0, 0.0)),)


def test_refuses_what_it_cannot_say(table, tmp_path):
    cases = [
        ((table(2), {}), "6 joints, but 'part 7' has 2"),
        ((table(7), {}), "6 joints, but 'part 7' has 7"),
        ((dataclasses.replace(table(), period=0.001), {}), "whole cycles of 2 ms"),
        ((dataclasses.replace(table(), period=0.005), {}), "every 5 ms"),
        ((table(), {"outputs": {"tool": 8}}), "from 0 to 7"),
        ((table(), {"outputs": {"tool": "doTool"}}), "must be a number"),
        ((table(), {"outputs": {"gas": 1}}), "only on or off"),
        ((table(events=said("a\\b", 1.0)), {}), "backslashes"),
        ((table(events=said("a", "line\nbreak")), {}), "of one line"),
        ((table(events=said("a", 'the "b"')), {}), "without quotes"),
    ]
    refusals(lambda x: program(x[0], tmp_path, **x[1]), cases)
    assert not list(tmp_path.iterdir())
