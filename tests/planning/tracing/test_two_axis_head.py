"""Machines with three slides and two rotary axes, whose tool axis is near the pole of the head."""

import re

import numpy as np
import pytest
from tests.oracle import head_machine as machine

import armcontour as ac
from armcontour.files import parse_job
from armcontour.robot import JointPreference

DOWN = machine.leaning(0, 0)
SPEED = 0.1
ALLOWED = np.radians(0.1)
NOISES = (0.0, 5e-10, 1e-8, 1e-6)


@pytest.fixture(scope="module")
def load(tmp_path_factory):
    """Loads the machine with a head."""
    folder = tmp_path_factory.mktemp("machines")

    def load_machine(name, slides="xyz"):
        file = folder / f"{name.replace('/', '')}_{slides}.urdf"
        file.write_text(machine.description(name, slides))
        arm = ac.load_arm(file)
        limits = arm.limits.replace(joint_acceleration=machine.ACCELERATIONS, speed=SPEED)
        return arm.with_limits(limits)

    return load_machine


def path_through(points, axes, noise=0.0):
    """Polyline of many points through a few, with noise in points [m] and axes, rounded."""
    rng = np.random.default_rng(3)
    place = np.arange(len(points))
    fine = np.linspace(0, place[-1], 20 * place[-1] + 1)
    points, axes = (np.array(x, dtype=float).T for x in (points, axes))
    dense = np.stack([np.interp(fine, place, x) for x in points], axis=1)
    along = np.stack([np.interp(fine, place, x) for x in axes], axis=1)
    dense += rng.uniform(-noise, noise, dense.shape)
    along += 1e3 * rng.uniform(-noise, noise, along.shape)
    path = ac.Path.polyline(dense).pointing(along)
    return ac.round_corners(path, tolerance=1e-3, angular_tolerance=np.radians(2))


SQUARE = [[1, 1, 2], [1.5, 1, 2], [1.5, 1.4, 2], [1, 1.4, 2], [1, 1, 2]]
LINE = [[x, 1, 2] for x in (1, 1.3, 1.4, 1.7, 1.8, 2.1)]
CIRCLE = [[1.5 + 0.2 * np.cos(x), 1.5 + 0.2 * np.sin(x), 2] for x in np.linspace(0, 6.28, 8)]
A, B, OPPOSITE = (machine.leaning(30, x) for x in (0, 2.0, np.pi))
JOBS = {
    "square": (SQUARE, [DOWN] * 5),
    "circle": (CIRCLE, [DOWN] * 8),
    "bevel, vertical, bevel": (LINE, [A, A, DOWN, DOWN, B, B]),
    "across the pole": (LINE, [A, A, A, OPPOSITE, OPPOSITE, OPPOSITE]),
    "bevel to 45 deg": (LINE, [*[DOWN] * 3, *[machine.leaning(45, 1.0)] * 3]),
}


def judge(name, path, joint_path, slides="xyz"):
    """Largest distance from the path [m], and angle from the required axis [rad]."""
    s = np.linspace(0, path.length, 8001)
    point, axis = machine.tool_of(name, joint_path(s), slides)
    distance = np.linalg.norm(point - path(s), axis=1).max()
    return distance, machine.angles(axis, path.orientation(s)[:, :, 2]).max()


@pytest.mark.parametrize("job", JOBS)
@pytest.mark.parametrize("name", machine.HEADS)
def test_heads_follow_paths_near_their_pole(load, name, job):
    arm = load(name)
    durations = []
    for noise in NOISES:
        path = path_through(*JOBS[job], noise)
        planned = ac.plan(path, arm)
        (law,) = planned.laws
        distance, angle = judge(name, path, law.joint_path)
        assert distance < 1e-9
        assert angle <= ALLOWED * (1 + 1e-9)
        q, dq, ddq = (planned(np.linspace(0, planned.duration, 4001), k) for k in range(3))
        assert (np.abs(dq) <= np.array(machine.VELOCITIES) * (1 + 1e-9)).all()
        assert (np.abs(ddq) <= np.array(machine.ACCELERATIONS) * (1 + 1e-6)).all()
        # Between the bevels, the first axis turns by 2 rad, that of a nutating head by more.
        assert np.abs(np.diff(q[:, 3])).sum() < 2.7
        durations.append(planned.duration)
    assert np.ptp(durations) < 5e-3 * min(durations)
    assert durations[0] < path.length / SPEED + 0.6


# Points [mm] and leanings [degrees], azimuths [rad] of paths whose tool axis passes the pole at a
# distance of 0.1 to 0.4 degrees within a short length.
CLOSE = {
    "in 20 mm": ([0, 20, 30], [(12, 0), (8.4, np.pi + 0.02), (12, np.pi + 0.02)]),
    "in 100 mm": ([0, 100, 150], [(25, 0), (17.5, np.pi + 0.02), (25, np.pi + 0.02)]),
    "often": (
        [0, 50, 100, 130, 150, 200],
        [(25, 0), (25, np.pi + 0.01), (20, 0.02), (9, np.pi + 0.05), (25, 0.02), (20, 3.1)],
    ),
}


@pytest.mark.parametrize(
    ("name", "case"),
    [("C/A", "in 20 mm"), ("C/B", "in 20 mm"), ("C/B", "in 100 mm"), ("C/A", "often")],
)
def test_fast_passages_close_to_the_pole_stay_within_the_tolerance(load, name, case):
    along, directions = CLOSE[case]
    points = [[1 + 1e-3 * x, 1, 2] for x in along]
    path = ac.Path.polyline(points).pointing([machine.leaning(*x) for x in directions])
    path = ac.round_corners(path, tolerance=1e-3, angular_tolerance=np.radians(3))
    (law,) = ac.plan(path, load(name)).laws
    distance, angle = judge(name, path, law.joint_path)
    assert distance < 1e-9
    assert angle <= ALLOWED * (1 + 1e-9)


def test_cone_that_a_refusal_names_is_enough(load):
    """The first axis would leave its range of 189 degrees by turning about the pole."""
    arm = load("C/B")
    along, directions = CLOSE["often"]
    points = [[1 + 1e-3 * x, 1, 2] for x in along]
    path = ac.Path.polyline(points).pointing([machine.leaning(*x) for x in directions])
    path = ac.round_corners(path, tolerance=1e-3, angular_tolerance=np.radians(3))
    with pytest.raises(ac.Unreachable) as caught:
        ac.plan(path, arm)
    assert caught.value.limit == "joint_upper" and caught.value.joint == 3
    cone = np.radians(float(re.search(r"cone of ([\d.]+) deg", str(caught.value))[1]))
    leaning = path.with_cone(cone)
    (law,) = ac.plan(leaning, arm).laws
    distance, angle = judge("C/B", path, law.joint_path)
    assert distance < 1e-9
    assert ALLOWED < angle <= cone * (1 + 1e-9)


def test_job_with_a_fast_passage_close_to_the_pole_is_planned(tmp_path):
    (tmp_path / "machine.urdf").write_text(machine.description("C/B"))
    (tmp_path / "limits.yaml").write_text(machine.joint_limits())
    along, directions = CLOSE["in 20 mm"]
    points = [[1 + 1e-3 * x, 1, 2] for x in along]
    axes = ", ".join(f"{{axis: {machine.leaning(*x).tolist()}}}" for x in directions)
    text = (
        BEVELED[: BEVELED.index("path:")] + f"path:\n  points: {points}\n  orientation: [{axes}]\n"
    )
    run = ac.run(parse_job(text + BEVELED[BEVELED.index("corners:") :], folder=tmp_path))
    (row,) = [x for x in run.runs["cut"].to_data().rows if x.name == "lean"]
    assert row.value <= ALLOWED * (1 + 1e-9)


def test_first_axis_is_held_along_a_constant_axis_at_the_pole(load):
    joint_path = ac.trace(path_through(*JOBS["square"]), load("C/A"))
    q = joint_path(np.linspace(0, joint_path.length, 500))
    assert np.ptp(q[:, 3]) < 1e-9
    assert np.abs(q[:, 4]).max() < 1e-9


def test_tool_axis_is_exact_away_from_the_pole(load):
    path = path_through(SQUARE, [machine.leaning(20, 0.5)] * 5)
    distance, angle = judge("C/A", path, ac.trace(path, load("C/A")))
    assert distance < 1e-9
    assert angle < 1e-8


@pytest.mark.parametrize("slides", ["zxy", "yzx"])
def test_slides_have_any_order(load, slides):
    path = path_through(*JOBS["bevel, vertical, bevel"])
    joint_path = ac.trace(path, load("C/A", slides))
    distance, angle = judge("C/A", path, joint_path, slides)
    assert distance < 1e-9
    assert angle <= ALLOWED


def test_a_plan_that_is_exact_but_spins_is_not_used(load):
    path = path_through([[1, 1, 2], [2, 1, 2]], [DOWN, DOWN], 1e-6)
    joint_path = ac.trace(path, load("C/A"))
    assert np.abs(np.diff(joint_path(np.linspace(0, path.length, 2000))[:, 3])).sum() < 0.1


def test_a_path_that_starts_at_given_joints_starts_there(load):
    arm = load("C/A")
    path = path_through(*JOBS["square"])
    free = ac.trace(path, arm)(0.0)
    seed = free.copy()
    seed[3] = 1.0
    seed[:3] += path.start - machine.tool_of("C/A", seed[None])[0][0]
    np.testing.assert_allclose(ac.trace(path, arm, seed=seed)(0.0), seed, atol=1e-6)


def test_direction_that_a_head_cannot_reach_is_named(load):
    path = path_through(LINE, [*[DOWN] * 3, *[machine.leaning(120, 1.0)] * 3])
    with pytest.raises(ac.Unreachable):
        ac.trace(path, load("B/A"))


@pytest.mark.parametrize(
    ("joint", "lower", "upper"),
    [
        # The bevels are 30 deg, in directions that are 2 rad apart.
        (4, -0.4, 0.4),
        (4, 0.02, 1.0),
        (3, 0.3, 1.4),
        (3, -0.3, 0.9),
    ],
)
def test_axis_of_a_head_that_leaves_its_range_is_named(load, joint, lower, upper):
    arm = load("C/A")
    path = path_through(*JOBS["bevel, vertical, bevel"])
    ends = {"joint_lower": lower, "joint_upper": upper}
    own = dict(zip(ends, arm.limits.joint_range(arm.dof), strict=True))

    def narrowed(**changes):
        """The arm with another range of the joint."""
        values = {name: own[name].copy() for name in ends}
        for name, value in (ends | changes).items():
            values[name][joint] = value
        return arm.with_limits(arm.limits.replace(**values))

    with pytest.raises(ac.Unreachable) as caught:
        ac.trace(path, narrowed())
    error = caught.value
    assert error.joint == joint
    assert f"joint {joint + 1} ({arm.joint_names[joint]})" in str(error)
    assert error.allowed == ends[error.limit]
    assert (error.needed - error.allowed) * (1 if error.limit == "joint_upper" else -1) > 0
    if joint == 4:
        expected = 0.0 if lower > 0 else np.copysign(np.radians(30), error.allowed)
        assert error.needed == pytest.approx(expected, abs=ALLOWED)
    # With this range and a degree of room, the path is traced, but not with a smaller one.
    room = np.copysign(np.radians(1), error.needed - error.allowed)
    joint_path = ac.trace(path, narrowed(**{error.limit: error.needed + room}))
    distance, angle = judge("C/A", path, joint_path)
    assert distance < 1e-9
    assert angle <= ALLOWED * (1 + 1e-9)
    with pytest.raises(ac.Unreachable):
        ac.trace(
            path, narrowed(**{error.limit: error.allowed + 0.3 * (error.needed - error.allowed)})
        )


def test_direction_outside_of_the_cone_of_a_head_is_refused_with_its_angle(load):
    # The tool leans at most twice the angle between both axes, 90 deg.
    path = path_through(LINE, [*[DOWN] * 3, *[machine.leaning(120, 1.0)] * 3])
    with pytest.raises(ac.Unreachable) as caught:
        ac.trace(path, load("nutating"))
    assert caught.value.joint is None
    assert caught.value.limit == "orientation"
    assert caught.value.needed == pytest.approx(np.radians(30), abs=1e-6)


@pytest.mark.parametrize(
    ("held", "named"),
    [
        ({"first": 0.5}, {"first"}),
        ({"second": 0.2}, {"second"}),
        ({"first": 0.5, "second": 0.0}, {"first", "second"}),
        ({"first": 0.5, "x": 1.5}, {"first", "x"}),
    ],
)
def test_held_joint_that_keeps_the_tool_from_a_direction_is_named(load, held, named):
    arm = load("C/A")
    path = path_through(*JOBS["bevel, vertical, bevel"])
    preferences = {name: JointPreference(hold=x) for name, x in held.items()}
    with pytest.raises(ac.Unreachable) as caught:
        ac.trace(path, arm.with_preferences(preferences))
    message = str(caught.value)
    assert caught.value.limit == "orientation"
    assert caught.value.joint == min(arm.joint_names.index(x) for x in named)
    assert "preferences hold" in message
    (remedy,) = [x for x in message.split(". ") if x.startswith("Do not hold")]
    assert {x for x in arm.joint_names if x in remedy.split(",")[0].split()} == named
    # The remedy that the message names is traced.
    others = {name: x for name, x in preferences.items() if name not in named}
    joint_path = ac.trace(path, arm.with_preferences(others))
    assert judge("C/A", path, joint_path)[0] < 1e-9


JOB = """
name: plate
arm: {file: machine.urdf, joint_limits: limits.yaml, tip: tool0}
path:
  points: [[1, 1, 2], [1.2, 1, 2], [1.2, 1.2, 2], [1, 1.2, 2], [1, 1, 2]]
  orientation: {axis: [0, 0, -1]}
corners: {tolerance: 1 mm}
limits: {speed: 100 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {cut: {}}
"""


def test_job_states_the_tolerance_and_the_angle_used(tmp_path):
    (tmp_path / "machine.urdf").write_text(machine.description("C/A"))
    (tmp_path / "limits.yaml").write_text(machine.joint_limits())
    run = ac.run(parse_job(JOB, folder=tmp_path)).runs["cut"]
    (row,) = [x for x in run.to_data().rows if x.name == "lean"]
    assert row.value < 1e-8
    assert any("0.1 deg" in x and "first" in x for x in run.remarks)
    q = run.trajectory(np.linspace(0, run.trajectory.duration, 300))
    assert np.ptp(q[:, 3]) < 1e-9


def test_job_with_a_held_joint_of_the_head_is_refused_like_in_python(tmp_path):
    (tmp_path / "machine.urdf").write_text(machine.description("C/A"))
    (tmp_path / "limits.yaml").write_text(machine.joint_limits())
    text = BEVELED.replace("tip: tool0}", "tip: tool0, preferences: {first: {hold: 30 deg}}}")
    with pytest.raises(ac.Unreachable) as caught:
        ac.run(parse_job(text, folder=tmp_path))
    assert caught.value.joint == 3
    assert "Do not hold first" in str(caught.value)


def test_job_whose_head_leaves_its_range_is_refused_like_in_python(tmp_path):
    text = machine.description("C/A")
    narrow = text.replace('lower="-1.6" upper="1.6"', 'lower="-0.1" upper="0.1"')
    assert narrow != text
    (tmp_path / "machine.urdf").write_text(narrow)
    (tmp_path / "limits.yaml").write_text(machine.joint_limits())
    with pytest.raises(ac.Unreachable) as caught:
        ac.run(parse_job(BEVELED, folder=tmp_path))
    assert caught.value.joint == 4
    assert abs(caught.value.allowed) == 0.1
    assert abs(caught.value.needed) == pytest.approx(np.arctan(0.4), abs=ALLOWED)


BEVELED = JOB.replace(
    "{axis: [0, 0, -1]}",
    "[{axis: [0.4, 0, -1]}, {axis: [0, 0, -1]}, {axis: [0, 0, -1]}, {axis: [0, 0.4, -1]}, "
    "{axis: [0, 0.4, -1]}]",
).replace("{tolerance: 1 mm}", "{tolerance: 1 mm, angular_tolerance: 2 deg}")


@pytest.mark.parametrize("text", [JOB, BEVELED])
def test_resumed_job_keeps_the_joint_positions(text, tmp_path):
    (tmp_path / "machine.urdf").write_text(machine.description("C/A"))
    (tmp_path / "limits.yaml").write_text(machine.joint_limits())
    resumed = text.replace("runs:", "process: {resume_at: 0.3}\nruns:")
    whole, rest = (
        ac.run(parse_job(x, folder=tmp_path)).runs["cut"].trajectory.laws[0].joint_path
        for x in (text, resumed)
    )
    s = np.linspace(0, rest.length, 300)
    along = s + whole.length - rest.length
    np.testing.assert_allclose(rest(s), whole(along), atol=1e-4)
    np.testing.assert_allclose(rest(0.0), whole(along[0]), atol=1e-9)
    distance, angle = judge("C/A", rest.tool_path, rest)
    assert distance < 1e-9
    assert angle <= ALLOWED * (1 + 1e-9)


@pytest.mark.parametrize("text", [JOB, BEVELED])
def test_approach_and_retract_continue_the_contour_without_a_joint_motion(text, tmp_path):
    (tmp_path / "machine.urdf").write_text(machine.description("C/A"))
    (tmp_path / "limits.yaml").write_text(machine.joint_limits())
    text = text.replace("runs:", "process: {approach: 20 mm, retract: 20 mm}\nruns:")
    plan = ac.run(parse_job(text, folder=tmp_path)).runs["cut"].trajectory
    assert [x.kind for x in plan.spans] == ["rapid", "contour", "rapid"]
