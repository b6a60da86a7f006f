"""Outputs that are on along contours only, with the gaps of the program."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.io.drawings.gcode import read_gcode
from armcontour.io.drawings.reading import Reading

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


def laser(**options):
    program = read_gcode(LASER, source="laser.nc", reading=Reading())
    return ac.prepare(program, ac.Process(**options))


def states(contour, name="spindle"):
    return [(x.value, round(x.s, 9)) for x in contour.events if x.name == name]


def test_g_code_leaves_what_is_on_over_rapids():
    first, second, third = laser().contours
    assert [states(x) for x in (first, second, third)] == [[], [(False, 0.03)], []]


def test_it_is_off_between_and_on_again_as_it_was():
    found = laser(off_between=("spindle",))
    first, second, third = found.contours
    assert states(first) == [("reverse", 0.0), (False, 0.02)]
    assert [x[0] for x in states(second)] == ["reverse", False]
    # It was off at the end of the second, and stays so.
    assert states(third) == []
    assert not [x for x in found.moves if isinstance(x, ac.Event) and x.name == "spindle"]


def test_other_names_stay_as_they_are():
    assert [states(x) for x in laser(off_between=("coolant",)).contours] == [
        states(x) for x in laser().contours
    ]


def test_a_program_is_off_along_every_rapid(refuses):
    program = laser(off_between=("spindle",)).placed(ac.Frame(position=(0.3, 0.1, 0)))
    arm = ac.load_arm("pmk3s")
    planned = ac.plan(program, arm, arm.limits.replace(speed=0.05))
    on = False
    times = [(x.t, x.value) for x in planned.events if x.name == "spindle"]
    for span in planned.spans:
        middle = sum(span.t) / 2
        for t, value in times:
            if t <= middle:
                on = value is not False
        expected = span.kind == "contour" and span.name != "line 10"
        assert on == expected, span.name


PRINT = b"""G21 G90 F1200
M83
G1 X10
G1 X20 E1
G1 X30
G1 X40 E1
"""


def test_a_switch_of_an_output_that_the_file_switches_adds_its_leads_only():
    program = read_gcode(PRINT, source="part.gcode", reading=Reading())
    switch = ac.Switch(name="extruder", on_lead=0.02, off_lead=0.01)
    (contour,) = ac.prepare(program, ac.Process(switch=switch)).contours
    assert states(contour, "extruder") == [
        (True, 0.01),
        (False, 0.02),
        (True, 0.03),
        (False, 0.04),
    ]
    assert [x.lead_time for x in contour.events] == [0.02, 0.01, 0.02, 0.01]


def test_a_contour_that_a_file_runs_with_the_output_off_stays_off():
    third = laser(switch=ac.Switch(name="spindle", value=0.5)).contours[2]
    assert states(third) == []


def test_open_contours_begin_every_pass_in_the_same_state():
    path = ac.Path.polyline([(0, 0), (0.1, 0)])
    gap = ac.Event(name="laser", value=False, s=0.09)
    process = ac.Process(switch=ac.Switch(name="laser"), passes=2)
    first, second = ac.prepare(
        ac.Program(moves=(ac.Contour(path=path, events=(gap,)),)), process
    ).contours
    assert states(first, "laser") == states(second, "laser") == [(True, 0.0), (False, 0.09)]


def test_tabs_and_gaps_of_the_program_leave_the_output_off_in_both():
    square = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1), (0, 0)])
    tab = ac.Tabs(width=0.01, count=1)
    process = ac.Process(begin="drawn", switch=ac.Switch(name="laser"), tabs=tab)

    def cut(*events):
        contour = ac.Contour(path=square, events=events)
        (found,) = ac.prepare(ac.Program(moves=(contour,)), process).contours
        return states(found, "laser")

    start, (_, off), (_, on), end = cut()
    gap = [
        ac.Event(name="laser", value=x, s=s) for x, s in ((False, off + 4e-3), (True, on + 1e-2))
    ]
    assert cut(*gap) == [start, (False, off), (True, round(on + 1e-2, 9)), end]
    gap = [
        ac.Event(name="laser", value=x, s=s) for x, s in ((False, off - 4e-3), (True, on - 4e-3))
    ]
    assert cut(*gap) == [start, (False, round(off - 4e-3, 9)), (True, on), end]


def test_resuming_behind_a_contour_with_tabs_keeps_the_output_off_until_the_work():
    circles = [
        ac.Path.polyline(
            [(x + 0.02 * np.cos(a), 0.02 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 60)]
        )
        for x in (0.0, 0.1)
    ]
    process = ac.Process(
        switch=ac.Switch(name="laser"),
        tabs=ac.Tabs(count=2, width=0.002),
        lead_in=ac.Lead(length=0.004),
        dwell=0.3,
        from_s=circles[0].length + 0.03,
    )
    program = ac.Program(moves=tuple(ac.Contour(path=x) for x in circles))
    moves = ac.prepare(program, process).moves
    between = [x.value for x in moves if isinstance(x, ac.Event)]
    assert not any(between)
    (rest,) = (x for x in moves if isinstance(x, ac.Contour))
    assert states(rest, "laser")[0] == (True, pytest.approx(0.004))
