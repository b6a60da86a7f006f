"""The documented Franka recipe in the loop with libfranka's rate limiter.

Formulas and constants of libfranka, `include/franka/rate_limiting.h` and `src/rate_limiting.cpp`,
version 0.9.2 for the Panda and 0.15.0 for the FR3; written anew in NumPy.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import armcontour as ac

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "controllers" / "franka.md"
CYCLE = 1e-3
# kLimitEps, subtracted from every constant.
EPS = 1e-3
ACCELERATION = {
    "panda": np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]) - EPS,
    "fr3": np.full(7, 10.0) - EPS,
}
JERK = {
    "panda": np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]) - EPS,
    "fr3": np.full(7, 5000.0) - EPS,
}
# A change of a command below this is rounding [rad].
ROUNDING = 1e-12


def velocity_limits(name, q):
    """Lower and upper limit of the joint velocities at the joint positions q [rad/s]."""
    if name == "panda":
        # kTolNumberPacketsLost is 3 for the Panda.
        limit = np.array([2.175] * 4 + [2.61] * 3) - EPS - 3 * CYCLE * ACCELERATION[name]
        return -limit, limit
    velocity = np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])
    offset = np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35])
    slope = np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0])
    above = np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]) - q
    below = np.array([2.7501, 1.7918, 2.9065, 3.0481, 2.8101, -0.54092, 3.0196]) + q
    bounds = [
        np.minimum(velocity, np.maximum(0.0, np.sqrt(np.maximum(0.0, slope * x)) - offset)) - EPS
        for x in (below, above)
    ]
    return -bounds[0], bounds[1]


def commands_changed(name, commands):
    """Number of joint commands that the limiter changes, fed with its own earlier output."""
    acceleration = ACCELERATION[name]
    jerk = JERK[name]
    ratio = jerk / acceleration
    q = commands[0]
    dq = np.zeros(7)
    ddq = np.zeros(7)
    changed = 0
    for command in commands[1:]:
        low, high = velocity_limits(name, q)
        jerk_command = (((command - q) / CYCLE - dq) / CYCLE - ddq) / CYCLE
        a = ddq + np.clip(jerk_command, -jerk, jerk) * CYCLE
        a = np.minimum(a, np.minimum(ratio * (high - dq), acceleration))
        a = np.maximum(a, np.maximum(ratio * (low - dq), -acceleration))
        before = dq
        dq = dq + a * CYCLE
        q = q + dq * CYCLE
        ddq = (dq - before) / CYCLE
        changed += int((np.abs(q - command) > ROUNDING).sum())
    return changed


def recipes():
    """Joint limits of the jobs on the documentation page, by arm."""
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    jobs = [yaml.safe_load(x) for x in blocks]
    limits = {x["arm"]: x.get("limits", {}) for x in jobs}
    return {
        arm: {k: x for k, x in y.items() if k.startswith("joint_")} for arm, y in limits.items()
    }


def commands_of(planned):
    t = np.append(np.arange(0.0, planned.duration, CYCLE), [planned.duration] * 3)
    return planned(t)


def square(arm, limits):
    corners = [(0.40, -0.05), (0.50, -0.05), (0.50, 0.05), (0.40, 0.05), (0.40, -0.05)]
    path = ac.Path.polyline([(x, y, 0.3) for x, y in corners]).pointing((0.0, 0.0, -1.0))
    rounded = ac.round_corners(path, tolerance=0.5e-3, continuity="curvature")
    return ac.plan(rounded, arm, limits.replace(speed=0.5))


def fast_line(arm, limits):
    line = ac.Path.polyline([(0.4, -0.4, 0.4), (0.4, 0.4, 0.4)]).pointing((0.0, 0.0, -1.0))
    return ac.plan(line, arm, limits)


def joint_line(arm, limits):
    ends = [[-1.8, -0.6, 0.0, -2.0, 0.0, 1.5, 0.0], [1.8, 0.6, 1.0, -1.0, 1.0, 2.5, 1.5]]
    return ac.plan(ac.JointPath.spline(np.array(ends)), arm, limits)


@pytest.mark.parametrize("move", [square, fast_line, joint_line])
@pytest.mark.parametrize("name", ["panda", "fr3"])
def test_the_limiter_changes_no_command_of_the_recipe(name, move):
    arm = ac.load_arm(name)
    planned = move(arm, arm.limits.replace(**recipes()[name]))
    if move is not square:
        # The motion is at a velocity limit of the recipe, so the limits are tested.
        v = np.abs(planned(np.linspace(0.0, planned.duration, 3000), 1)).max(axis=0)
        assert (v / recipes()[name]["joint_velocity"]).max() > 0.999
    assert commands_changed(name, commands_of(planned)) == 0


def test_the_limiter_changes_commands_at_the_limits_of_the_data_sheet():
    arm = ac.load_arm("panda")
    sheet = arm.limits.replace(joint_jerk=JERK["panda"] + EPS)
    assert commands_changed("panda", commands_of(joint_line(arm, sheet))) > 100
    # The velocity limits of the FR3 in its whole range.
    limits = ac.load_arm("fr3").limits
    for q in (limits.joint_lower, limits.joint_upper):
        low, high = velocity_limits("fr3", q)
        # libfranka subtracts EPS; the maker's values are rounded to 1e-4 rad.
        assert (limits.joint_velocity <= np.minimum(-low, high) + 1.5 * EPS).all()
