"""Jobs that several test files run: the paper's contour, and a short line in space."""

import pytest
from tests.jobs.making import a_run

import armcontour as ac
from armcontour.jobs import Rounding


@pytest.fixture(scope="module")
def paper_job(arm, objective, servo, limits):
    """The paper's contour with two runs; the gains of the plant differ from the nominal ones."""
    proposed = a_run(
        "proposed",
        timing=ac.Paper(knots=60),
        compensation=ac.PolePlacement(poles=[-100.0, -100.0, -100.0]),
        limits=limits,
        rounding=Rounding(tolerance=5e-3),
        end_time=6.0,
    )
    conventional = a_run(
        "conventional",
        timing=ac.Conventional(),
        compensation=ac.NoCompensation(),
        limits=limits.replace(speed=0.04),
        cycle=1e-2,
    )
    return ac.Job(
        name="paper",
        title="The paper's job",
        arm=arm,
        path=objective,
        servo=servo,
        plant_servo=ac.ServoModel(kp=[24.0, 26.0], kv=150.0),
        runs=(proposed, conventional),
    )


@pytest.fixture(scope="module")
def line_job():
    """A short line of the UR5e, which plans quickly."""
    arm = ac.load_arm("ur5e")
    path = ac.Path.polyline([[0.4, 0.0, 0.2], [0.5, 0.05, 0.2]]).oriented([1.0, 0.0, 0.0, 0.0])
    line_run = a_run(compensation=ac.NoCompensation(), limits=arm.limits.replace(speed=0.25))
    servo = ac.ServoModel(kp=25.0, kv=150.0).for_joints(6)
    return ac.Job(name="line", title="A line", arm=arm, path=path, servo=servo, runs=(line_run,))
