"""Waits for inputs of the robot: where they stand among the moves, and when events are due."""

import dataclasses

import numpy as np
import pytest
from tests.jobs.making import ARM
from tests.program.test_preparing import kinds

import armcontour as ac
from armcontour.program import Contour, Dwell, Event, Lead, Pierce, Program, Switch, Wait, prepare

SQUARE = ac.Path.polyline([(0.30, 0.16), (0.34, 0.16), (0.34, 0.20), (0.30, 0.20), (0.30, 0.16)])
BEND = ac.Path.polyline([(0.36, 0.16), (0.38, 0.16), (0.38, 0.18)])
TWO = Program(moves=(Contour(path=SQUARE), Contour(path=BEND)))
CLAMP = Wait("clamp", within=2.0)
ARC = Wait("arc", within=0.5, at="switched_on", rest=0.2)
LIMITS = ARM.limits.replace(speed=0.05, centripetal_acceleration=0.09)


def planned(program, process):
    return ac.plan(prepare(program, process), ARM, LIMITS)


def test_tool_rests_at_the_start_of_each_contour_while_the_robot_waits():
    process = ac.Process(wait=CLAMP, switch=Switch("torch", on_lead=0.3))
    assert kinds(prepare(TWO, process)) == "Dwell Dwell Contour Rapid Dwell Dwell Contour"
    plan = planned(TWO, process)
    assert [(x.input, x.within, x.at, x.rest) for x in plan.waits] == [
        ("clamp", 2.0, "start", 0.1)
    ] * 2
    for wait, span, contour in zip(plan.waits, plan.contour_spans, TWO.contours, strict=True):
        begin = SQUARE((SQUARE.length + 0.04) / 8) if contour.closed else contour.path(0.0)
        t = np.linspace(wait.t, span.t[0], 30)
        tool = ARM.tool_position(plan(t))
        np.testing.assert_allclose(tool, np.tile(tool[0], (30, 1)), atol=1e-12)
        assert contour.closed or np.allclose(tool[0], begin, atol=1e-9)
        # The process is switched on after the wait, with its whole lead time.
        on = next(x for x in plan.events if x.value and x.due == pytest.approx(span.t[0]))
        assert on.t >= wait.t + wait.rest - 1e-9 and on.due - on.t == pytest.approx(0.3)


def test_robot_waits_for_the_process_right_after_it_is_switched_on():
    gas = Event("gas", True, s=0.0, lead_time=0.6)
    wire = Event("wire", True, s=0.0, lead_time=0.1)
    process = ac.Process(
        wait=[ARC, CLAMP],
        switch=Switch("torch"),
        events=(gas, wire),
        dwell=0.05,
        pierce=Pierce(0.25),
    )
    plan = planned(Program(moves=(Contour(path=BEND),)), process)
    clamp, arc = plan.waits
    assert (clamp.input, arc.input) == ("clamp", "arc")
    t = {x.name: x.t for x in plan.events if x.value}
    start = plan.contour_spans[0].t[0]
    # Gas leads the torch by the difference of both leads, and comes after the fixture is closed.
    assert t["torch"] == pytest.approx(arc.t) and t["torch"] - t["gas"] == pytest.approx(0.35)
    assert t["gas"] >= clamp.t + clamp.rest - 1e-9
    # The piercing begins when the arc burns; the wire comes relative to the motion.
    assert start - (arc.t + arc.rest) == pytest.approx(0.25)
    assert start - t["wire"] == pytest.approx(0.1)


def test_slower_motion_keeps_its_rests():
    plan = planned(TWO, ac.Process(wait=CLAMP))
    slow = plan.stretched(0.5)
    assert [x.rest for x in slow.waits] == [0.1, 0.1]
    for wait, span in zip(slow.waits, slow.contour_spans, strict=True):
        assert span.t[0] - wait.t == pytest.approx(0.1)


def test_layers_and_a_process_that_is_off_have_their_own_waits():
    layered = [dataclasses.replace(x, layer=y) for x, y in zip(TWO.contours, "AB", strict=True)]
    process = ac.Process(wait=CLAMP, by_layer={"A": {"wait": ()}, "B": {"wait": (CLAMP, ARC)}},
                         switch=Switch("torch"))  # fmt: skip
    moves = prepare(Program(moves=tuple(layered)), process).moves
    waits = [x.wait.input for x in moves if isinstance(x, Dwell) and x.wait is not None]
    assert waits == ["clamp", "arc"]
    assert {x.input for x in process.waits} == {"clamp", "arc"}
    off = dataclasses.replace(process, off=True)
    assert kinds(prepare(Program(moves=tuple(layered)), off)) == "Contour Contour"
    assert off.waits == ()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"wait": ARC}, "no output is switched"),
        ({"wait": ARC, "switch": Switch("torch"), "lead_in": Lead(5e-3)}, "lead-in"),
        ({"wait": "clamp"}, "wait"),
    ],
)
def test_waits_without_a_place_are_refused(keys, words):
    with pytest.raises(ac.InvalidInput, match=words):
        ac.Process(**keys)


def test_contour_that_is_not_switched_on_at_its_start_has_no_place_for_the_wait():
    late = Contour(path=BEND, events=(Event("torch", True, s=0.01),))
    with pytest.raises(ac.InvalidInput, match="contour 1"):
        prepare(Program(moves=(late,)), ac.Process(wait=ARC, switch=Switch("torch")))


def test_events_that_are_due_during_the_wait_are_refused():
    # The output of the first contour is switched off after the robot waits at the second one.
    delayed = Switch("torch", off_lead=-60.0)
    with pytest.raises(ac.InvalidInput, match="torch"):
        planned(TWO, ac.Process(wait=CLAMP, switch=delayed))
    early = Contour(path=BEND, events=(Event("gas", True, s=0.02, lead_time=20.0),))
    program = Program(moves=(Contour(path=SQUARE), Dwell(5.0), early))
    plan = planned(program, ac.Process(wait=CLAMP))
    assert plan.events[0].t >= plan.waits[1].t + 0.1 - 1e-9
