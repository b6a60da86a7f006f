"""URScript, read back by a small interpreter of the few statements that are written."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armcontour.errors import InvalidInput
from armcontour.io.exports import Table, write_table
from armcontour.motion import TimedEvent

SERVOJ = re.compile(r"servoj\(\[([^\]]*)\], 0, 0, ([\d.]+), lookahead, gain\)")
MOVEJ = re.compile(r"movej\(\[([^\]]*)\], a=0.3, v=0.2\)")
OUTPUT = re.compile(r"set_standard_digital_out\((\d), (True|False)\)")
ANALOG = re.compile(r"set_standard_analog_out\(([01]), (\d\.\d{4})\)")
TEXT = re.compile(r'textmsg\("([^"]*)"\)')


def run(text: str) -> tuple[list[Any], list[tuple[float, Any]], np.ndarray]:
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


def program(table: Table, tmp_path: FilePath, **options: Any) -> str:
    write_table(table, tmp_path / "a.script", format="urscript", **options)
    return (tmp_path / "a.script").read_text(encoding="utf-8")


def test_every_set_point_has_its_time_and_the_way_to_the_first_is_slow(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    given = table(count=30, events=())
    points, events, first = run(program(given, tmp_path))
    assert len(points) == len(given.q) + 1 and not events
    np.testing.assert_allclose([x for x, _ in points[:-1]], given.t, rtol=0, atol=1e-12)
    np.testing.assert_allclose([q for _, q in points[:-1]], given.q, rtol=0, atol=0.5000001e-6)
    np.testing.assert_allclose(points[-1][1], given.q[-1], rtol=0, atol=0.5000001e-6)
    np.testing.assert_allclose(first, given.q[0], rtol=0, atol=0.5000001e-6)


def test_events_come_within_half_an_interval_and_the_set_points_stay_in_order(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    given = table(count=9)
    label = dataclasses.replace(given.events[2], value="plain words")
    given = dataclasses.replace(given, events=(*given.events[:2], label, *given.events[3:]))
    text = program(given, tmp_path, outputs={"tool": 3})
    points, events, _ = run(text)
    assert [what for _, what in events] == [
        (3, True),
        "gas=2.5",
        "label=plain words",
        (3, False),
        (3, True),
    ]
    for (at, _), event in zip(events, given.events, strict=True):
        assert abs(at - event.t) <= given.period / 2 + 1e-12
    np.testing.assert_allclose([q for _, q in points[:9]], given.q, rtol=0, atol=0.5000001e-6)
    exact = [float(x) for x in re.findall(r"# .* at ([\d.]+) s", text)]
    np.testing.assert_allclose(exact, [x.t for x in given.events], rtol=0, atol=0.5000001e-6)


def test_without_outputs_events_are_only_told(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    given = table()
    given = dataclasses.replace(given, events=tuple(x for x in given.events if x.name == "tool"))
    _, events, _ = run(program(given, tmp_path))
    assert [x for _, x in events] == ["tool=on", "tool=off", "tool=on"]


@given(
    st.integers(1, 12),
    st.lists(st.floats(0.0, 0.08), max_size=8),
    st.sampled_from([0.002, 0.004, 0.008]),
)
def test_any_events_come_in_order_within_half_an_interval(
    tmp_path_factory: pytest.TempPathFactory, count: int, times: list[float], period: float
) -> None:
    q = np.arange(6.0 * count).reshape(count, 6)
    events = [x for t in times for x in said("tool", True, t)]
    given_table = Table(
        name="any",
        joint_names=tuple("abcdef"),
        period=period,
        t=np.arange(count) * period,
        q=q,
        events=tuple(events),
    )
    points, found, _ = run(
        program(given_table, tmp_path_factory.mktemp("any"), outputs={"tool": 0})
    )
    at = [x for x, _ in found]
    assert len(at) == len(times)
    np.testing.assert_allclose(at, sorted(times), rtol=0, atol=period / 2 + 1e-9)
    np.testing.assert_array_equal([x for _, x in points[:count]], q)
    np.testing.assert_allclose([x for x, _ in points[:count]], given_table.t, atol=1e-12)
    assert all(x == q[-1].tolist() for _, x in points[count:])


@pytest.mark.parametrize("name", ["a;b", "gas (N2)", "it's", "x,y", "Düse"])
def test_a_name_without_quotes_and_backslashes_can_be_told(
    table: Callable[..., Table], tmp_path: FilePath, name: str
) -> None:
    events = [x for value in (True, False, 2.5, "on") for x in said(name, value)]
    _, told, _ = run(program(table(events=tuple(events)), tmp_path))
    assert [x for _, x in told] == [f"{name}={x}" for x in ("on", "off", "2.5", "on")]


def test_analog_outputs_are_set_at_the_set_points_where_they_change(
    table: Callable[..., Table], tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    power = np.array([0.0, 0.2, 0.2, 0.60004, 1.0, 1.0, 0.3, 0.0, 0.0])
    given = dataclasses.replace(table(count=9, events=()), analog={"power": power})
    for output in ("AO1", 1):
        points, events, _ = run(program(given, tmp_path, outputs={"power": output}))
        assert events == [
            (pytest.approx(given.t[k]), ("AO1", round(power[k], 4))) for k in (0, 1, 3, 4, 6, 7)
        ]
        assert len(points) == 10
    assert "analog" not in program(given, tmp_path)
    for output in ("AO2", 2, "ao", True, -1):
        wrong = {"power": output}
        refuses(lambda o=wrong: program(given, tmp_path, outputs=o), InvalidInput, "AO0 or AO1")
    high = dataclasses.replace(given, analog={"power": 1000 * power})
    refuses(
        lambda: program(high, tmp_path, outputs={"power": 0}), InvalidInput, "power", "1000", "to 1"
    )


def test_contours_are_named_where_they_begin_and_the_call_is_an_option(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    given = dataclasses.replace(table(count=9, events=()), name="7 Löcher")
    given = dataclasses.replace(given, contours=((0.0, "rim"), (given.t[4], "hole 2")))
    lines = program(given, tmp_path).splitlines()
    assert lines[0] == "def armcontour_7_L_cher():" and lines[-1] == "end"
    before = [
        sum("servoj" in x for x in lines[:i]) for i, x in enumerate(lines) if "# contour" in x
    ]
    assert before == [0, 4] and "  # contour hole 2" in lines
    called = program(given, tmp_path, call=True).splitlines()
    assert called == [*lines, "", "armcontour_7_L_cher()"]


def said(name: str, value: Any, t: float = 0.0) -> tuple[TimedEvent, ...]:
    return (TimedEvent(name=name, value=value, t=t, due=t, s=0.0, point=(0.0, 0.0)),)


def test_refuses_what_it_cannot_say(
    table: Callable[..., Table], tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    cases: list[tuple[Table, dict[str, Any], str]] = [
        (table(2), {}, "6 joints, but 'part 7' has 2"),
        (table(7), {}, "6 joints, but 'part 7' has 7"),
        (dataclasses.replace(table(), period=0.001), {}, "whole cycles of 2 ms"),
        (dataclasses.replace(table(), period=0.005), {}, "every 5 ms"),
        (table(), {"outputs": {"tool": 8}}, "from 0 to 7"),
        (table(), {"outputs": {"tool": "doTool"}}, "must be a number"),
        (table(), {"outputs": {"gas": 1}}, "only on or off"),
        (table(events=said("a\\b", 1.0)), {}, "backslashes"),
        (table(events=said("a", "line\nbreak")), {}, "of one line"),
        (table(events=said("a", 'the "b"')), {}, "without quotes"),
    ]
    for refused, options, words in cases:
        refuses(lambda g=refused, o=options: program(g, tmp_path, **o), InvalidInput, words)
    assert not list(tmp_path.iterdir())
