"""Outputs are on only along contours, with the gaps of the program."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.files.drawings.gcode import read_gcode
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.program import Lead, Switch, Tabs

LASER = b"""G21 G90 F1200
M4 S800
G0 X0 Y0
G1 X20
G0 X0 Y10
G1 X20
X30
M5
G0 X0 Y20
G1 X20
"""
GLUE = b"G21 G90 F1200\nG0 X10\nM62 P1\nG1 X20\nM63 P1\nG1 X30\nM62 P1\nG1 X40\n"
SWITCH = Switch(name="laser")


def laser(**options):
    program = read_gcode(LASER, source="laser.nc", options=ReadOptions())
    return ac.prepare(program, ac.Process(**options))


def states(contour, name="spindle"):
    return [(x.value, round(x.s, 9)) for x in contour.events if x.name == name]


def contours(path, *events, **process):
    """What becomes of a path with events."""
    drawn = ac.Program(moves=(ac.Contour(path=path, events=events),))
    return ac.prepare(drawn, ac.Process(switch=SWITCH, **process)).contours


def test_outputs_that_are_on_during_rapids_are_switched_off():
    drawn = laser()
    separated = laser(off_between=("spindle",))
    assert [states(x) for x in drawn.contours] == [[], [(False, 0.03)], []]
    first, second, third = map(states, separated.contours)
    assert first == [("reverse", 0.0), (False, 0.02)]
    assert [x[0] for x in second] == ["reverse", False]
    # It was off at the end of the second, and stays so.
    assert third == []
    assert not [x for x in separated.moves if isinstance(x, ac.Event) and x.name == "spindle"]
    # Other names stay as they are.
    other = laser(off_between=("coolant",))
    assert [states(x) for x in other.contours] == [states(x) for x in drawn.contours]
    program = laser(off_between=("spindle",)).placed(ac.Frame(position=(0.3, 0.1, 0)))
    arm = ac.load_arm("pmk3s")
    planned = ac.plan(program, arm, arm.limits.replace(speed=0.05))
    on = False
    times = [(x.t, x.value) for x in planned.events if x.name == "spindle"]
    for span in planned.spans:
        for t, value in times:
            if t <= sum(span.t) / 2:
                on = value is not False
        assert on == (span.kind == "contour" and span.name != "line 10"), span.name


def test_a_switch_adds_only_leads_if_the_file_switches_the_output():
    program = read_gcode(GLUE, source="part.ngc", options=ReadOptions())
    switch = Switch(name="output 1", on_lead=0.02, off_lead=0.01)
    (contour,) = ac.prepare(program, ac.Process(switch=switch)).contours
    expected = [(True, 0.0), (False, 0.01), (True, 0.02), (False, 0.03)]
    assert states(contour, "output 1") == expected
    assert [x.lead_time for x in contour.events] == [0.02, 0.01, 0.02, 0.01]
    # A contour that a file runs with the output off stays off.
    assert states(laser(switch=Switch(name="spindle", value=0.5)).contours[2]) == []


def test_passes_and_tabs_keep_the_outputs_of_the_program():
    gap = ac.Event(name="laser", value=False, s=0.09)
    first, second = contours(ac.Path.polyline([(0, 0), (0.1, 0)]), gap, passes=2)
    assert states(first, "laser") == states(second, "laser") == [(True, 0.0), (False, 0.09)]
    square = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1), (0, 0)])

    def cut(*gap):
        events = (
            ac.Event(name="laser", value=x, s=s) for x, s in zip((False, True), gap, strict=False)
        )
        tabs = Tabs(width=0.01, count=1)
        (contour,) = contours(square, *events, begin="drawn", tabs=tabs)
        return states(contour, "laser")

    start, (_, switch_off), (_, on), end = cut()
    later = round(on + 1e-2, 9)
    sooner = round(switch_off - 4e-3, 9)
    assert cut(switch_off + 4e-3, on + 1e-2) == [start, (False, switch_off), (True, later), end]
    assert cut(switch_off - 4e-3, on - 4e-3) == [start, (False, sooner), (True, on), end]


def test_after_a_resume_the_output_stays_off_until_the_contour_begins():
    angles = np.linspace(0, 2 * np.pi, 60)
    ring = 0.02 * np.column_stack([np.cos(angles), np.sin(angles)])
    circles = [ac.Path.polyline(ring + [x, 0.0]) for x in (0.0, 0.1)]
    work = {"tabs": Tabs(count=2, width=0.002), "lead_in": Lead(length=0.004), "dwell": 0.3}
    process = ac.Process(switch=SWITCH, **work, resume_at=circles[0].length + 0.03)
    program = ac.Program(moves=tuple(ac.Contour(path=x) for x in circles))
    moves = ac.prepare(program, process).moves
    assert not any(x.value for x in moves if isinstance(x, ac.Event))
    (rest,) = (x for x in moves if isinstance(x, ac.Contour))
    assert states(rest, "laser")[0] == (True, pytest.approx(0.004))
