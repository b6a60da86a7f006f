"""The last joint turns about the axis of the tool, whose point it does not move."""

import numpy as np

import armcontour as ac
from armcontour.robot.servo.simulation import JointServo, LoggedCommand, follow

T = np.arange(6250) * 4e-3
START = np.array([0.4, -1.4, 1.7, -1.9, -1.55, 0.3])


def program(seed):
    """Commands of six joints: small multisines, or steps, so often only some joints move."""
    random = np.random.default_rng(seed)
    u = np.tile(START, (len(T), 1))
    for j in range(6):
        if seed == 1:
            f = random.uniform(0.5, 20.0, (40, 1))
            phases = random.uniform(0, 2 * np.pi, (40, 1))
            u[:, j] += 5e-4 * np.sum(np.sin(2 * np.pi * f * T + phases), axis=0)
            continue
        for _ in range(8):
            time, width, size = random.uniform((1.0, 0.1, -0.12), (24.0, 0.22, 0.12))
            u[:, j] += size * (np.tanh((T - time) / width) + 1) / 2
    return u - u[0] + START


def robot_log(seed, names):
    u = program(seed)
    random = np.random.default_rng(seed + 90)
    servos = [JointServo(kp=28.0 + j, kv=140.0 + 5 * j, dead_time=4e-3) for j in range(6)]
    q = [
        follow(LoggedCommand(T, u[:, j].copy(), "linear"), servos[j], u[0, j], 0.0)
        for j in range(6)
    ]
    y = np.stack(q, axis=1).reshape(u.shape) + random.normal(0, 3e-6, u.shape)
    return ac.Log(t=T, command=u, measured=y, joint_names=names, source=f"{seed}.csv")


def test_a_joint_that_does_not_move_the_tool_is_rated_by_its_own_motion():
    arm = ac.load_arm("ur5e")
    logs = [robot_log(1, arm.chain.joints), robot_log(2, arm.chain.joints)]
    identified = ac.identify(logs, ac.ServoFit(kinematics=arm))
    last = identified.joints[-1]
    assert last.share < 0.02 and last.contour_ratio < 0.1
    assert identified.judgement.trusted
