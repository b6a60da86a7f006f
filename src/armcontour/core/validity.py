"""For what a result holds, and what it does not prove; docs/glossary.md defines the terms."""

from __future__ import annotations

# For what errors and a verdict hold: for simulated servos or bodies, or for measured joints and the
# kinematics of the arm. No result of this package is measured at the tool.
AS_MODELLED = "as modelled"
AT_ENCODERS = "at the motor encoders"


def not_part(others: str) -> str:
    """Return the sentence that ends a result: what the result does not prove.

    `others`: what this kind of result does not prove, besides what no result does.
    """
    no_result = "elasticity and backlash of gears, calibration of the arm, tool and part"
    return f"Not part of this result: {others}, {no_result}."


# The sentences of a plan, a program whose controller plans the motion between points, a simulation,
# a certificate, and of logs of a robot.
OF_PLAN = not_part("lag of the servos")
OF_PROGRAM = not_part("other motions of the controller between the points, lag of its servos")
OF_SIMULATION = not_part("servos that differ from the model")
OF_CERTIFICATE = not_part("friction, load, collisions")
OF_LOGS = not_part("other motions, loads and temperatures")
