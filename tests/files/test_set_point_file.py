"""Results as files: set-points, placements and summaries."""

import dataclasses
import json
import zipfile

import numpy as np
import pytest
import yaml
from tests.corner_job import CORNER_JOB
from tests.files.tables import refusals

from armcontour import load_arm
from armcontour.control.learning import LearningResult, LearningRun
from armcontour.core.render import plain
from armcontour.files import parse_job, parse_trajectory, write_planned, write_set_points
from armcontour.files.exports import export
from armcontour.files.lesson_file import LESSON, read_lesson, write_lesson
from armcontour.files.result_folder import to_json
from armcontour.files.set_point_reader import read_set_points
from armcontour.jobs import run
from armcontour.jobs.run_learning import plan_run
from armcontour.motion import SetPoints
from armcontour.motion.set_point_rule import SetPointRule
from armcontour.robot.servo import ServoModel

SERVO = ServoModel(kp=[25 / 3, 24.0], kv=[150.0, 1000 / 7], dead_time=1 / 300).for_joints(2)


@pytest.fixture(scope="module")
def job():
    return parse_job(CORNER_JOB)


@pytest.fixture(scope="module")
def plan(job):
    return plan_run(job, None)


def learned(plan, step=1e-3):
    """A lesson whose set-points are those of the plan and a little more."""
    set_points = plan.set_points
    zeros = np.zeros(2)
    run = LearningRun(
        q=set_points.q, error=np.zeros((5, 2)), noise=zeros, rest=zeros, rests_later=zeros > 0,
        joint_rms=zeros, joint_max=zeros, tool_rms=0.0, tool_max=0.0,
    )  # fmt: skip
    return LearningResult(
        cycle=set_points.cycle, q=set_points.q + step / 3, trajectory=set_points.trajectory,
        method="learning", start_time=-set_points.cycle, runs=(run,), servo=SERVO, best=0,
        repeats=0.0,
    )  # fmt: skip


def put(folder, job, set_points, lesson=None):
    folder.mkdir(exist_ok=True)
    write_set_points(folder / "set_points.csv", set_points, job.arm.joint_names)
    if lesson is not None:
        write_lesson(folder / LESSON, lesson)
    return folder / "set_points.csv"


def test_set_points_read_from_a_file_are_recognized_as_those_of_the_job(job, plan, tmp_path):
    file = put(tmp_path, job, plan.set_points)
    assert read_set_points(file, job, plan) is plan.set_points
    # Degrees with few digits will do.
    table = np.column_stack([plan.set_points.t * 1e3, np.degrees(plan.set_points.q)])
    np.savetxt(file, table, "%.4f", ",", header="t [ms],q1 [deg],q2 [deg]", comments="")
    assert read_set_points(file, job, plan) is plan.set_points
    # An export begins at zero.
    delayed_plan = dataclasses.replace(plan, set_points=changed(plan, by=0.0, start_time=-0.008))
    export(delayed_plan.set_points, tmp_path / "export.csv", arm=job.arm)
    assert read_set_points(tmp_path / "export.csv", job, delayed_plan) is delayed_plan.set_points
    # With a history it is the lesson, to the last bit.
    lesson = learned(plan)
    lesson_read = read_set_points(put(tmp_path, job, lesson, lesson), job, plan)
    assert isinstance(lesson_read, LearningResult) and len(lesson_read.runs) == 1
    assert (
        lesson_read.q.tobytes() == lesson.q.tobytes()
        and lesson_read.start_time == lesson.start_time
    )


def changed(plan, where=slice(None), by=1e-6, **fields):
    q = plan.set_points.q.copy()
    q[where] += by
    return SetPoints(**({"cycle": 0.004, "trajectory": plan.trajectory, "method": "x"}
                         | {"q": q} | fields))  # fmt: skip


def test_set_points_that_do_not_belong_to_the_job_are_refused(job, plan, tmp_path):
    still = changed(plan, by=0.0)
    lesson = learned(plan)
    other = dataclasses.replace(lesson.runs[0], q=lesson.runs[0].q + 1e-6)
    other = dataclasses.replace(lesson, runs=(other,))
    table = [
        ((changed(plan, (50, 1)),), "set_points.csv has other set-points"),
        ((dataclasses.replace(still, q=still.q[:-1]),), "set_points.csv has other set-points"),
        ((changed(plan, by=0.0, cycle=0.005),), "set_points.csv has other set-points"),
        # Histories of other set-points, and of another job.
        ((plan.set_points, lesson), "lesson.npz in its folder"),
        ((other, other), "Specify the original job"),
    ]
    refusals(lambda x: read_set_points(put(tmp_path, job, *x), job, plan), table)
    refusals(lambda x: read_set_points(x, job, plan), [(tmp_path, "has no result")])


def made(plan, runs=2):
    """A lesson with numbers of all digits."""
    random = np.random.default_rng(1)
    q = random.standard_normal((30, 2)) / 3

    def run(k):
        return LearningRun(
            q=q + k * np.pi, error=random.standard_normal((40, 2)),
            noise=np.array([1e-5, 2e-5]) / 3, rest=random.random(2),
            rests_later=np.array([True, False]),
            joint_rms=random.random(2),
            joint_max=random.random(2), tool_rms=0.1 / 3, tool_max=0.2 / 3,
            contour_rms=None if k else 1 / 7, offset=-100 / 3, source="run, 'ü'.csv",
            notes=("joint 1 saturates.",) * k,
        )  # fmt: skip

    return LearningResult(
        cycle=0.004, q=q, trajectory=plan.trajectory, method="learning", start_time=-0.004,
        runs=tuple(run(k) for k in range(runs)), servo=SERVO, noise=1e-7 / 3,
        best=0, repeats=1e-5 / 3, setbacks=1, reason="because",
    )  # fmt: skip


def same(first, second):
    for x in dataclasses.fields(first):
        a, b = getattr(first, x.name), getattr(second, x.name)
        if x.name == "runs":
            assert len(a) == len(b)
            for one, other in zip(a, b, strict=True):
                same(one, other)
        elif isinstance(a, ServoModel):
            same(a, b)
        elif isinstance(a, SetPointRule):
            np.testing.assert_equal(a.data(), b.data())
        elif isinstance(a, np.ndarray):
            assert a.dtype == b.dtype and a.tobytes() == b.tobytes()
        else:
            assert a == b and type(a) is type(b), x.name


def test_a_stored_learning_result_is_restored_exactly(plan, tmp_path):
    lesson = made(plan)
    write_lesson(tmp_path / "a.npz", lesson)
    lesson_read = read_lesson(tmp_path / "a.npz", plan.trajectory)
    same(lesson, lesson_read)
    write_lesson(tmp_path / "b.npz", lesson_read)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz") as lesson_read:
        np.testing.assert_array_equal(lesson_read["q"], lesson.q)
        np.testing.assert_array_equal(lesson_read["run 2: error"], lesson.runs[1].error)


def other(first=False, **values):
    """Change the text of a file, or what it has of the first run."""

    def change(parts):
        about = json.loads(parts["about.json"])
        (about["runs"][0] if first else about).update(values)
        parts["about.json"] = json.dumps(about).encode()

    return change


def test_damaged_and_other_files_are_refused(plan, tmp_path):
    def read(change):
        file = tmp_path / "a.npz"
        write_lesson(file, made(plan))
        with zipfile.ZipFile(file) as source:
            parts = {x: source.read(x) for x in source.namelist()}
        change(parts)
        with zipfile.ZipFile(file, "w") as target:
            for name, content in parts.items():
                target.writestr(name, content)
        return read_lesson(file, plan.trajectory)

    table = [
        (other(version=99), "version 99 ... requires version 6"),
        (other(runs=[]), "a.npz ... at least one run"),
        (lambda parts: parts.update({"q.npy": b"\x93NUMPY garbage"}), "damaged"),
        (lambda parts: parts.pop("about.json"), "damaged"),
    ]
    refusals(read, table)
    (tmp_path / "text.npz").write_text("t,q1\n")
    others = [("no.npz", "no lesson file"), ("text.npz", "not a lesson file")]
    refusals(lambda x: read_lesson(tmp_path / x, plan.trajectory), others)


JOB = yaml.safe_load("""
name: corner
arm: {name: ur5e, payload: {mass: 1 kg}}
path:
  points: [[0.4, 0, 0.2], [0.5, 0, 0.2], [0.5, 0.1, 0.2]]
  orientation: [&a {rpy: [180 deg, 0, 0]}, *a, {rpy: [180 deg, 0, 0.2]}]
limits: {speed: 0.25, centripetal_acceleration: 1}
corners: {tolerance: 1 mm, angular_tolerance: 0.05 deg}
servo: {kp: 25, kv: 150}
experiment: {payload: {mass: 1.2 kg}}
runs: {plain: {compensation: {method: none}}, tried: {}}
""")


@pytest.fixture(scope="module")
def job_result():
    return run(parse_job(yaml.safe_dump(JOB)))


@pytest.fixture(scope="module")
def job_data(job_result):
    return json.loads(to_json(plain(job_result.to_data())))


def test_the_summary_states_torques_start_and_assumed_masses(job_data, job_result):
    arm = job_data["arm"]
    plain = job_data["runs"]["plain"]
    tried = job_data["runs"]["tried"]
    assert arm["joints"][0] == "shoulder_pan_joint" and arm["masses_known"]
    assert arm["assumed"] == load_arm("ur5e").chain.assumed
    for torque in (plain["torque"], tried["experiment"]["torque"]):
        assert torque["assumed"] == arm["assumed"]
    for name, result in job_result.runs.items():
        start = job_data["runs"][name]["start"]
        assert list(start) == list(job_result.job.arm.joint_names)
        assert list(start.values()) == result.trajectory(0.0).tolist()
    torque = plain["torque"]
    assert torque["limit"] == [150, 150, 150, 28, 28, 28]
    np.testing.assert_allclose(plain["torque_ratio"], np.divide(torque["peak"], torque["limit"]))
    peak = np.abs(job_result.runs["tried"].experiment.execution.torque).max(axis=0)
    np.testing.assert_array_equal(tried["experiment"]["torque"]["peak"], peak)
    # How the tool turned.
    assert tried["angular_speed"] > 0.1
    assert 0 < tried["orientation_error"]["rms"] < tried["orientation_error"]["max"] < 0.02
    assert tried["corners"][0]["angular_error"] == pytest.approx(np.radians(0.05), rel=1e-6)
    units = {x: job_data["units"][x] for x in ("angular_error", "torque.peak", "start")}
    assert units == {"angular_error": "rad", "torque.peak": "N m", "start": "rad"}


def written(tmp_path, write, *arguments):
    """What a function writes to a file."""
    write(tmp_path / "written.csv", *arguments)
    return (tmp_path / "written.csv").read_text(encoding="utf-8")


def test_columns_have_joint_names_and_are_read_again(job_result, tmp_path):
    plan = job_result.runs["plain"].trajectory
    names = job_result.job.arm.joint_names
    text = written(tmp_path, write_planned, plan.sample(4e-3), names)
    assert text.startswith("t [s],q shoulder_pan_joint [rad],")
    samples = parse_trajectory(text, names)
    t = np.minimum(samples.t, plan.duration)
    np.testing.assert_allclose(samples.q, plan(t), atol=1e-11)
    np.testing.assert_allclose(samples.dq, plan(t, 1), atol=1e-11)
    assert samples.ddq is not None
    # Joints that are only numbered keep their numbers.
    text = written(tmp_path, write_planned, plan.sample(0.1))
    numbered = [f"joint {j + 1}" for j in range(6)]
    assert written(tmp_path, write_planned, plan.sample(0.1), numbered) == text
    assert text.startswith("t [s],q 1 [rad],q 2 [rad]")
