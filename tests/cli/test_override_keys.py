"""Keys of the terminal during `play`."""

from __future__ import annotations

import pytest

from armcontour.cli.override_keys import OverrideKeys


def pressed(start: float, *keys: tuple[str, float]) -> OverrideKeys:
    """The state after keys were pressed, each at a time [s]."""
    state = OverrideKeys(start)
    for key, now in keys:
        state.press(key, now)
    return state


def test_space_only_pauses_and_r_goes_on():
    state = pressed(0.5, (" ", 0.0))
    assert state() == 0.0
    state.press(" ", 1.0)
    assert state() == 0.0, "a second press does not move the robot"
    state.press("r", 2.0)
    assert state() == 0.5


def test_plus_and_minus_change_the_speed_up_to_100_percent():
    seconds = iter(range(100))
    state = OverrideKeys(0.1)
    speeds = []
    for key in "+++++-":
        state.press(key, float(next(seconds)))
        speeds.append(state())
    assert speeds == [0.25, 0.5, 0.75, 1.0, 1.0, 0.75]
    state = pressed(0.02, *(("-", float(x)) for x in range(5)))
    assert state() == 0.01
    # From a speed between two steps, to the next one.
    assert pressed(0.3, ("+", 0.0))() == 0.5 and pressed(0.3, ("-", 0.0))() == 0.25


def test_a_held_key_counts_once():
    repeats = [0.0, 0.66, *(0.66 + 0.03 * k for k in range(100))]
    assert pressed(0.1, *(("+", x) for x in repeats))() == 0.25
    assert pressed(0.1, ("+", 0.0), ("+", 1.0))() == 0.5
    assert pressed(0.1, ("+", 0.0), ("-", 0.1), ("+", 0.2))() == 0.25


def test_a_change_of_the_speed_during_a_pause_does_not_move_the_robot():
    state = pressed(0.5, (" ", 0.0), ("+", 1.0))
    assert state() == 0.0
    state.press("r", 2.0)
    assert state() == 0.75


@pytest.mark.parametrize("key", ["x", "\x1b", "\n", ""])
def test_other_keys_do_nothing(key):
    state = pressed(0.5, (key, 0.0))
    assert state() == 0.5 and not state.ended.is_set()


def test_q_ends():
    assert pressed(0.5, ("q", 0.0)).ended.is_set()
