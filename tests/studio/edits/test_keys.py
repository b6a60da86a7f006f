"""Edits of values."""

from __future__ import annotations

from typing import Any

import pytest
from tests.studio.edits.editing import PLANE, edited

from armcontour._yaml import load
from armcontour.errors import InvalidInput


def set_to(key: str, value: Any, run: str = "own", text: str = PLANE) -> dict:
    return edited(text, run, do="set", key=key, value=value)


def test_a_value_goes_to_the_run_if_it_has_its_own_else_to_the_job() -> None:
    assert set_to("limits.speed", 0.05)["runs"]["own"]["limits"]["speed"] == "50 mm/s"
    found = set_to("limits.speed", 0.2, "mac")
    assert found["limits"]["speed"] == "0.2 m/s" and "limits" not in found["runs"]["mac"]
    assert set_to("limits.joint_acceleration", 0.5)["limits"]["joint_acceleration"] == "0.5 rad/s^2"
    assert set_to("command_interval", 1e-3)["runs"]["own"]["command_interval"] == 1e-3
    assert set_to("command_interval", 1e-3, "mac")["command_interval"] == "1 ms"
    assert set_to("corners.tolerance", 1e-3)["runs"]["own"]["corners"] == {"tolerance": "1 mm"}
    assert set_to("corners.tolerance", 1e-3, "mac")["corners"] == {"tolerance": "1 mm"}
    assert set_to("timing.reserve", 0.1)["runs"]["own"]["timing"] == {"reserve": "10 %"}
    assert set_to("runs.mac.timing.knots", 100)["runs"]["mac"]["timing"]["knots"] == 100


def test_values_are_taken_as_typed_lifted_and_unset() -> None:
    assert set_to("limits.speed", "3 m/min")["runs"]["own"]["limits"]["speed"] == "3 m/min"
    # A number without a unit has that of the old value.
    assert set_to("limits.speed", "30")["runs"]["own"]["limits"]["speed"] == "30 mm/s"
    assert set_to("limits.tool_acceleration", "2")["limits"]["tool_acceleration"] == "2 m/s^2"
    assert set_to("command_interval", "0.001")["runs"]["own"]["command_interval"] == 1e-3
    assert set_to("limits.joint_velocity", None)["limits"]["joint_velocity"] is None
    gone = edited(PLANE, do="unset", key="limits.speed")
    assert gone["runs"]["own"]["limits"] == {} and gone["limits"]["speed"] == "0.15 m/s"
    assert edited(PLANE, do="unset", key="limits.joint_jerk") == load(PLANE, "")


def test_one_joint_of_several_gets_a_list_in_the_unit_that_was_written() -> None:
    found = set_to("servo.kp.1", 30.0)
    assert found["servo"]["kp"] == ["25 1/s", "30 1/s"]
    listed = PLANE.replace("kp: 25 1/s", "kp: [25 1/s, 26.0]")
    assert set_to("servo.kp.1", 30.0, text=listed)["servo"]["kp"] == ["25 1/s", 30.0]
    for key, words in (("servo.kp.2", "number of the joint"), ("name.1", "no values of single")):
        with pytest.raises(InvalidInput, match=words):
            set_to(key, 1.0)


def test_choices_take_away_what_does_not_go_with_them() -> None:
    assert set_to("timing.method", "optimal", "mac")["runs"]["mac"]["timing"] == {
        "method": "optimal"
    }
    poles = PLANE.replace("{method: none}", "{method: pole_placement, poles: [-9, -9, -9]}")
    found = set_to("compensation.method", "inverse", "mac", poles)
    assert found["runs"]["mac"]["compensation"] == {"method": "inverse"}
    assert set_to("corners.shape", "sharp", "mac")["corners"] == "sharp"
    assert set_to("corners.shape", "free", "mac")["corners"]["shape"] == "free"
    assert set_to("corners.shape", "arc")["runs"]["own"]["corners"] == {
        "shape": "arc",
        "tolerance": "1 mm",
    }
