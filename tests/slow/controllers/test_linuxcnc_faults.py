"""LinuxCNC machines that differ from the simulation."""

import pytest
from tests.controllers.test_linuxcnc import HAL, needs_linuxcnc, needs_own_hal, play_own_file

pytestmark = [needs_linuxcnc, needs_own_hal]
# A motion in which this machine was late is repeated.
TRIES = 5
LATE = ("came late", "not ready in time", "received nothing")
# Gains of the HAL file that convert to degrees and to rad.
IN_DEGREES = "57.29577951308232"
IN_RAD = "0.017453292519943295"
# Replaced parts of the file, the verdict or the class of the error, and words of its message.
FAULTS = {
    "none": ({}, True, ()),
    "one drive is off": (
        {"=> pid-1.enable pid-2.enable": "=> pid-1.enable"},
        "ControllerRefused",
        ("to the start", "Joint 2"),
    ),
    "a period of 0.5 ms": ({"period1=1000000": "period1=500000"}, True, ()),
    "a period of 1/1200 s": ({"period1=1000000": "period1=833333"}, True, ()),
    "a period of 4 ms": ({"period1=1000000": "period1=4000000"}, True, ()),
    "a following error": ({"min -3": "min -0.9", "max 3": "max 0.9"}, False, ("Joint",)),
    "a range": ({"range-1.min -90": "range-1.min -5"}, False, ("Joint",)),
    "saturated velocities": (
        {"maxoutput 60": "maxoutput 15", "min -3": "min -300", "max 3": "max 300"},
        False,
        ("Joint",),
    ),
    "commands in rad": (
        {IN_DEGREES: "1", "offset -115": "offset -2.00713", "offset 120": "offset 2.0944"},
        "ControllerRefused",
        ("have not moved",),
    ),
    "one joint measured in degrees": (
        {f"to-rad-2.gain {IN_RAD}": "to-rad-2.gain 1"},
        "ControllerRefused",
        ("to the start", "Joint 2"),
    ),
    "all in degrees": (
        {IN_DEGREES: "1", IN_RAD: "1", "offset 2.007128639793479": "offset 115",
         "offset -2.0943951023931953": "offset -120"},
        "ControllerRefused",
        ("turn", "unit"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_linuxcnc_machine_that_differs_from_the_simulation_is_not_kept(fault, tmp_path):
    changes, verdict, words = FAULTS[fault]
    text = HAL
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    for _ in range(TRIES):
        result, *notes = play_own_file(tmp_path, text)
        if not any(x in note for note in notes for x in LATE):
            break
    else:
        pytest.skip(f"This machine is too busy: {' '.join(notes)}")
    assert result == verdict, notes
    assert all(x in " ".join(notes) for x in words), notes
