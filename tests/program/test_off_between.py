"""What is on over rapids and shall not be: switched off at ends, and on again as it was."""

from __future__ import annotations

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
