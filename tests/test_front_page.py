"""The figures of the README: each cause of a contour error is measured on one plan."""

import re
from pathlib import Path

import pytest

import armcontour as ac

README = Path(__file__).parent.parent / "README.md"
PERIOD = 4e-3
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
# Its velocity loop takes its command 1 ms later, to first order.
DELAYED = SERVO.replace(kp=25.0 / 0.975, kv=150.0 * 0.975)


@pytest.fixture(scope="module")
def measured():
    """Duration [s], and RMS and largest contour error [mm], by the rows of the table."""
    arm = ac.load_arm("pmk3s")
    objective = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3), (0.35, 0.35)])
    rounded = ac.round_corners(objective, tolerance=5e-3)
    limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
    slow = ac.plan(objective, arm, limits.replace(speed=0.04), method="conventional")
    full, kept = (ac.plan(rounded, arm, limits, reserve=x) for x in (0.0, 0.02))

    def row(plan, path, servo=SERVO, bodies=False, **how):
        taught = ac.compensate(plan, SERVO, period=PERIOD, **how)
        plant = ac.RigidBodyPlant(arm, servo) if bodies else ac.ServoPlant(arm, servo, limits)
        error = ac.evaluate(ac.execute(taught, plant), path).contour_error
        return plan.duration, error.rms * 1e3, error.max * 1e3

    return [
        row(slow, objective, method="none"),
        row(kept, rounded, method="none"),
        row(kept, rounded),
        row(kept, rounded, DELAYED),
        row(full, rounded, DELAYED),
        row(kept, rounded, bodies=True),
        row(kept, rounded, bodies=True, arm=arm),
    ]


def test_the_table_of_the_readme_is_what_is_computed(measured):
    lines = [x for x in README.read_text(encoding="utf-8").splitlines() if " s | " in x]
    for row, line in zip(measured, lines, strict=True):
        printed = re.findall(r"\d+\.\d+", line.split("|", 2)[2])
        for value, text in zip(row, printed, strict=True):
            assert value == pytest.approx(float(text), abs=0.51 * 10 ** -len(text.split(".")[1]))
