"""The options --on, --address and --hal of the command play."""

import pytest

import armcontour as ac
from armcontour.cli.commands import ControllerOptions
from armcontour.cli.play_command import controller_of
from armcontour.controllers import Franka, Ur
from armcontour.files import parse_job

JOB = """
name: line
arm: {arm}
path: {{points: [[0.40, 0, 0.3], [0.45, 0, 0.3]]}}
servo: {{kp: 25, kv: 150}}
runs: {{plain: {{timing: {{method: optimal}}, compensation: {{method: none}}}}}}
"""


def job(arm):
    return parse_job(JOB.format(arm=arm))


def test_a_controller_gets_the_address_of_its_robot():
    franka = controller_of(job("fr3"), ControllerOptions(on="franka", address="192.0.2.7"))
    assert isinstance(franka, Franka) and franka.address == "192.0.2.7"
    ur = controller_of(job("ur5e"), ControllerOptions(on="ur", address="192.0.2.7"))
    assert isinstance(ur, Ur) and ur.address == "192.0.2.7"


@pytest.mark.parametrize(
    ("name", "address", "hal", "reason"),
    [
        ("franka", None, None, "--on franka requires the robot's address"),
        ("ur", None, None, "--on ur requires the robot's address"),
        ("ur", "192.0.2.7", "a.hal", "--hal is only allowed with --on linuxcnc"),
        ("linuxcnc", "192.0.2.7", None, "--address is only allowed with --on franka or ur"),
        ("kuka", "192.0.2.7", None, "--on must be one of linuxcnc, franka, ur"),
    ],
)
def test_invalid_combinations_of_controller_options_are_refused(name, address, hal, reason):
    with pytest.raises(ac.InvalidInput, match=reason):
        controller_of(job("ur5e"), ControllerOptions(on=name, address=address, hal=hal))
