"""Largest ratios to limits in a plan, compared with denser samples."""

import numpy as np
import pytest

import armcontour as ac

ARM = ac.load_arm("pmk3s")
LIMITS = ac.Limits.only(
    joint_acceleration=[[-0.6, 0.7], [-0.6, 0.9]],
    joint_velocity=[[-0.8, 0.7], [-0.6, 0.8]],
    joint_jerk=1e3,
    joint_lower=-3.0,
    joint_upper=[2.0, np.inf],
    speed=0.15,
    tool_acceleration=0.4,
    centripetal_acceleration=0.09,
)
PATH = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.28, 0.30)])


def dense(plan, places):
    """The same ratios at `places` points of every smooth part, by separate formulas."""
    joints = plan.laws[0].joint_path.breaks
    breaks = np.unique(np.append(plan.breaks, plan.time_at(joints)))
    share = np.linspace(1e-9, 1 - 1e-9, places)
    t = (breaks[:-1, None] + share * np.diff(breaks)[:, None]).ravel()
    q, dq, ddq, dddq = (plan(t, order) for order in range(4))
    v = np.einsum("nij,nj->ni", ARM.tool_jacobian(q), dq)
    a = np.einsum("nij,nj->ni", ARM.tool_jacobian(q), ddq)
    a += np.einsum("nij,nj->ni", ARM.tool_jacobian_rate(q, dq), dq)
    speed = np.hypot(*v.T)
    moving = speed > 1e-6
    across = np.abs(v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0])[moving] / speed[moving]
    return {
        "joint_acceleration": max((ddq / [0.7, 0.9]).max(), (-ddq / 0.6).max()),
        "joint_velocity": max((dq / [0.7, 0.8]).max(), (-dq / [0.8, 0.6]).max()),
        "joint_jerk": np.abs(dddq).max() / 1e3,
        "joint_lower": max((-q[:, 0] - 0.5).max() / 2.5, (np.pi - 3 - q[:, 1]).max() / np.pi),
        "joint_upper": (q[:, 0] + 0.5).max() / 2.5,
        "speed": speed.max() / 0.15,
        "tool_acceleration": np.hypot(*a.T).max() / 0.4,
        "centripetal_acceleration": across.max() / 0.09,
    }


def measured(plan, path, limits=LIMITS):
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    set_points = ac.compensate(plan, servo, ac.Inverse(), cycle=4e-3)
    executed = ac.simulate(set_points, ac.ServoPlant(ARM, servo))
    ratios = ac.evaluate(executed, path, limits=limits, limit_use=True).limit_ratios
    assert ratios is not None
    return dict(ratios)


@pytest.mark.parametrize(("method", "places"), [("optimal", 11), ("conventional", 200)])
def test_the_ratios_of_a_plan_equal_those_of_dense_samples(method, places):
    # Limits of jerk are not planned for, but counted.
    task = LIMITS.replace(joint_jerk=np.inf)
    options = ac.Optimal()
    path = ac.round_corners(PATH, tolerance=5e-3)
    if method == "conventional":
        task = ac.Limits.only(speed=0.04)
        path = PATH
        options = ac.Conventional()
    plan = ac.plan(path, ARM, task, options)
    ratios = measured(plan, path)
    for name, ratio in dense(plan, places).items():
        assert ratios[name] == pytest.approx(ratio, rel=1e-6, abs=1e-9), name
        # Peaks are higher than all places around them, however dense.
        assert ratios[name] >= ratio - 1e-9, name
