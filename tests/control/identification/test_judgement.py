"""Servo files are rated by the contour error on motion that was not fitted."""

import dataclasses
import warnings

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour.cli.command_execution import execute
from armcontour.cli.commands import Identify
from armcontour.cli.identify_command import identify as identify_logs
from armcontour.files import parse_job
from armcontour.files.limits_and_servo_files import read_servo
from armcontour.jobs.methods import COMPENSATIONS
from armcontour.report.identification import render_identification
from armcontour.robot.servo.simulation import JointServo, LoggedCommand, follow

SERVOS = (
    JointServo(kp=25.0, kv=150.0, dead_time=6e-3),
    JointServo(kp=28.0, kv=120.0, dead_time=6e-3),
)
T = np.arange(1500) * 4e-3


def program(seed):
    """Commands of two joints, multisines."""
    random = np.random.default_rng(seed)
    f = random.uniform(0.3, 6.0, (12, 1, 1))
    phases = random.uniform(0, 6.3, (12, 1, 2))
    return np.sum(0.02 / (1 + f) * np.sin(2 * np.pi * f * T[:, None] + phases), axis=0)


def robot_log(seed, gravity=0.0, share=0.0):
    """A log of a robot; a disturbance of the second joint differs between programs."""
    u = program(seed)
    q = [
        follow(LoggedCommand(T, u[:, j].copy(), "linear"), s, u[0, j], 0.0)
        for j, s in enumerate(SERVOS)
    ]
    y = np.stack(q, axis=1).reshape(len(T), 2)
    random = np.random.default_rng(seed + 50)
    other = np.cumsum(random.normal(size=len(T)))
    y[:, 1] += gravity * (other - other.mean()) / np.std(other)
    y += random.normal(0, 1e-6, y.shape)
    return ac.Log(t=T, command=u, measured=y, source=f"{seed}.csv")


@pytest.fixture(scope="module")
def good():
    return ac.identify([robot_log(1), robot_log(2)])


def test_compensation_is_judged_on_the_other_program(good):
    judged = good.judgement
    assert judged.programs == 2 and 0 < judged.ratio < 0.02 and judged.trusted
    assert all(x.contour_ratio < 0.02 for x in good.joints) and judged.errors.shape == (2, 2)
    servo = good.servo_model()
    assert servo.programs == 2 and servo.contour_ratio == pytest.approx(judged.ratio, rel=0.01)
    assert not servo.doubt


def test_a_result_with_a_weak_joint_is_not_trusted(good):
    weak = dataclasses.replace(good.joints[1], note="The model of joint 2 is weak.")
    doubtful = dataclasses.replace(good, joints=(good.joints[0], weak))
    sole = dataclasses.replace(good, judgement=dataclasses.replace(good.judgement, programs=1))
    for fit, trusted, state in (
        (good, True, "kept"), (sole, True, "doubtful"), (doubtful, False, "doubtful")
    ):  # fmt: skip
        assert fit.judgement.trusted
        assert fit.trusted == fit.to_data()["judgement.trusted"].value == trusted
        assert f'class="verdict {state}"' in render_identification(fit)


def test_a_joint_whose_contour_error_remains_in_a_log_is_weak(good):
    """A disturbance of the second joint, less than a fifth of its tracking error."""
    fit = ac.identify([robot_log(1, gravity=1.3e-3), robot_log(2)])
    assert fit.judgement.trusted and fit.joints[1].share < 0.2
    assert fit.joints[1].contour_ratio > 0.5 and "1.csv" in fit.joints[1].note
    assert not any(x.note for x in (fit.joints[0], *good.joints))


def test_judged_contour_error_equals_distance_of_tool_from_commanded_path(good):
    arm = ac.load_arm("pmk3s")
    fit = ac.identify([robot_log(1), robot_log(2)], ac.ServoFit(kinematics=arm))
    assert fit.judgement.ratio < 0.02
    # Without compensation, by another way: distance to the nearest point of a dense path.
    log = fit.logs[0]
    use = np.isfinite(fit.joints[0].rests[0])
    tool = arm.tool_position(log.measured)
    dense = np.linspace(T[0], T[-1], 300 * len(T))
    path = arm.tool_position(np.stack([np.interp(dense, T, x) for x in log.command.T], axis=1))
    away = [
        np.linalg.norm(path[max(300 * i - 10500, 0) : 300 * i + 600] - tool[i], axis=1).min()
        for i in np.flatnonzero(use)
    ]
    assert fit.judgement.errors[0, 0] == pytest.approx(np.sqrt(np.mean(np.square(away))), rel=0.2)
    with pytest.raises(ac.InvalidInput, match="Specify the arm"):
        ac.identify(robot_log(1), ac.ServoFit(kinematics=ac.load_arm("ur5e")))


def test_joints_of_a_log_are_sorted_by_their_names():
    arm = ac.load_arm("pmk3s")
    logs = [robot_log(1), robot_log(2)]
    turned = [
        dataclasses.replace(
            x,
            command=x.command[:, ::-1],
            measured=x.measured[:, ::-1],
            joint_names=arm.joint_names[::-1],
        )
        for x in logs
    ]
    options = ac.ServoFit(kinematics=arm)
    fit = ac.identify(turned, options)
    expected = ac.identify(logs, options)
    assert [x.name for x in fit.joints] == list(arm.joint_names)
    assert [x.servo for x in fit.joints] == [x.servo for x in expected.joints]
    np.testing.assert_array_equal(
        fit.predict(turned[0]).positions, expected.predict(logs[0]).positions
    )
    named = dataclasses.replace(logs[0], joint_names=("a", "b"))
    with pytest.raises(ac.InvalidInput, match="'a', 'b'"):
        ac.identify(named, options)


def test_positions_of_a_log_out_of_the_joint_range_are_refused():
    log = robot_log(1)
    limits = ac.Limits(joint_lower=[-3.0] * 2, joint_upper=[3.0] * 2)
    arm = ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=limits)
    far = dataclasses.replace(log, command=log.command + 60.0, measured=log.measured + 60.0)
    with pytest.raises(ac.InvalidInput, match="degrees"):
        ac.identify(far, ac.ServoFit(kinematics=arm))
    assert ac.identify(far).joints[0].written


def test_the_delay_that_joints_share_is_compensated_for_a_joint_without_a_model():
    logs = [robot_log(k, gravity=6e-3) for k in (1, 2)]
    fit = ac.identify(logs)
    one, two = fit.joints
    assert one.written and not two.written and two.note
    assert two.servo.dead_time == pytest.approx(1 / 28 + 6e-3, rel=0.3)
    arm = ac.load_arm("pmk3s")
    corner = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.35, 0.18)])
    path = ac.round_corners(corner, tolerance=5e-3)
    planned = ac.plan(path, arm, arm.limits.replace(speed=0.05), ac.Optimal(reserve=0.3))
    names = ("kp", "kv", "dead_time")
    truth = ac.ServoModel(**{x: [getattr(y, x) for y in SERVOS] for x in names})
    servo = fit.servo_model()
    errors = []
    for x, method in (
        (servo, "inverse"),
        (servo, "none"),
        (servo.replace(dead_time=servo.dead_time * [1, 0]), "inverse"),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            set_points = ac.compensate(planned, x, COMPENSATIONS[method]())
        executed = ac.simulate(set_points, ac.ServoPlant(arm, truth))
        errors.append(ac.evaluate(executed, path).contour_error.rms)
    # Compensation of one joint turns the delay of the other one into contour error.
    assert errors[0] < errors[1] < errors[2]


def test_a_fit_of_one_program_is_marked_provisional_in_the_file(good, tmp_path, capsys):
    files = []
    for log in (*good.logs, robot_log(1)):
        files.append(tmp_path / f"{len(files)}.csv")
        table = np.column_stack([log.t, log.command, log.measured])
        header = "t,u1,u2,q1,q2"
        np.savetxt(files[-1], table, delimiter=",", fmt="%.9f", header=header, comments="")
    assert execute(identify_logs, Identify(logs=files[:2], out=tmp_path / "two")) == 0
    # A program that is recorded twice is one program.
    again = Identify(logs=[files[0], files[2]], out=tmp_path / "one")
    assert execute(identify_logs, again) == 9
    assert "provisional" in capsys.readouterr().out
    servo, trusted = (read_servo(tmp_path / x / "servo.yaml", 2) for x in ("one", "two"))
    assert servo.programs == 1 and servo.doubt
    arm = ac.load_arm("pmk3s")
    line = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15)])
    planned = ac.plan(line, arm, arm.limits.replace(speed=0.05), ac.Optimal(reserve=0.1))
    with pytest.warns(UserWarning, match="may be worse than none"):
        ac.compensate(planned, servo)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ac.compensate(planned, trusted)
        ac.compensate(planned, servo, ac.NoCompensation())
    data = yaml.safe_load((tmp_path / "one" / "servo.yaml").read_text())
    job = {
        "name": "line",
        "arm": "pmk3s",
        **data,
        "path": {"points": [["0.35 m", "0.1 m"], ["0.41 m", "0.15 m"]]},
        "limits": {"speed": "50 mm/s"},
        "runs": {"only": {}},
    }
    job_result = ac.run(parse_job(yaml.safe_dump(job)))
    assert any("may be worse than none" in x for x in job_result.runs["only"].warnings)


def test_invalid_contour_ratios_and_programs_of_a_servo_are_refused():
    for record in ({"contour_ratio": -0.1}, {"programs": 0}, {"programs": 1.5}):
        with pytest.raises(ac.InvalidInput):
            ac.ServoModel(kp=25.0, kv=150.0, **record)
    assert ac.ServoModel(kp=25.0, kv=150.0, contour_ratio=0.6, programs=2).doubt
    assert not ac.ServoModel(kp=25.0, kv=150.0, contour_ratio=0.4, programs=2).doubt
