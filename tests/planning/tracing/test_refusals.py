"""Refusals name the range, the held axis, the tilt or the singularity that is the cause."""

import numpy as np
import pytest
from tests.planning.tracing.refused_jobs import (
    KINDS,
    TOOL,
    make_arm,
    make_path,
    narrow,
    reason,
    refused_job,
    singular_job,
)

import armcontour as ac
from armcontour.files import parse_job
from armcontour.robot import JointPreference

# Jobs by kind and seed, see `refused_jobs`.
JOBS = (
    *(("orientation", seed) for seed in (1, 2, 3, 4, 6, 9)),
    *(("axis", seed) for seed in (0, 2, 3, 5, 7, 18)),
    *(("rail", seed) for seed in (2, 3, 4, 5)),
    *(("positioner", seed) for seed in (2, 3, 4, 7)),
    *(("gantry", seed) for seed in (0, 3)),
    *(("cell", seed) for seed in (0, 1)),
)


@pytest.mark.parametrize(("kind", "seed"), JOBS)
def test_the_narrow_range_or_the_held_axis_is_named_and_the_remedies_work(kind, seed):
    job = refused_job(kind, seed)
    assert job.error.joint == job.joint
    assert f"joint {job.joint + 1} ({job.name})" in str(job.error)
    position = job.arm.chain.held.get(job.joint)
    if position is not None:
        assert job.error.limit == "hold" and job.error.allowed == position
    else:
        lower, upper = (x[job.joint] for x in job.arm.limits.joint_range(job.arm.dof))
        is_above = job.error.limit == "joint_upper"
        assert job.error.allowed == (upper if is_above else lower)
        assert (job.error.needed > upper) if is_above else (job.error.needed < lower)
    assert job.remedies()
    assert not job.wrong_remedies()
    np.testing.assert_allclose(job.error.point, job.path(job.error.s), atol=1e-9)


def test_a_job_close_to_the_end_of_a_range_is_traced():
    # Smoothing moves every joint path out of this range of the third slide.
    path = make_path("gantry", np.random.default_rng([KINDS.index("gantry"), 2]))
    arm = narrow(make_arm("gantry", 2), 2, 0.2, 1.0)
    traced = ac.trace(path, arm)
    s = np.linspace(0, path.length, 300)
    q = traced(s)
    lower, upper = arm.limits.joint_range(arm.dof)
    assert (q >= lower - 1e-9).all() and (q <= upper + 1e-9).all()
    np.testing.assert_allclose(arm.forward(q)[:, :3, 3], path(s), atol=1e-8)


@pytest.mark.parametrize("seed", [2, 3, 6, 9, 10, 11])
def test_a_path_through_a_singularity_without_another_way_is_singular(seed):
    path, _, error = singular_job(seed)
    assert error.limit == "singularity"
    assert error.s == pytest.approx(path.length / 2, abs=1e-3 * path.length)
    # Axes 4 and 6 are in line there.
    assert error.joint in (1, 2, 3, 5)


def head_cell(end):
    """A UR10e with a horizontal axis that turns a beam while the tool points downwards."""
    head = ac.PositionerAxis(
        name="head", axis=(0, 1, 0), origin=(0.9, 0, 0.4), lower=-end, upper=end, velocity=2.0,
        acceleration=2.0,
    )  # fmt: skip
    arm = ac.load_arm("ur10e").with_tool(TOOL)
    return arm.with_positioner(ac.Positioner(axes=(head,), tilt=np.radians(10)))


def test_a_helix_needs_as_many_turns_of_the_head():
    turns = 3
    angle = np.linspace(0, 2 * np.pi * turns, 40 * turns)
    outward = np.column_stack([np.sin(angle), np.zeros(len(angle)), np.cos(angle)])
    along = np.linspace(-0.1, 0.1, len(angle))[:, None] * [0.0, 1.0, 0.0]
    path = ac.Path.spline([0.9, 0, 0.4] + 0.08 * outward + along).pointing(-outward)
    assert reason(path, head_cell(20.0)) is None
    error = reason(path, head_cell(2 * np.pi))
    assert error.joint == 0 and error.limit in ("joint_lower", "joint_upper")
    # One end of the motion is at most at the other end of the range.
    assert abs(error.needed) > 2 * np.pi * turns - 2 * np.radians(10) - 2 * np.pi
    assert "720 deg wide" in str(error)


LINE = np.array([(-0.025, -0.044, 0.108), (-0.060, -0.009, 0.113)])
AXES = np.array([(0.089, -0.321, -0.683), (0.044, -0.429, -1.260)])


def table(tilt):
    """A UR10e with a table that tilts and turns."""
    axes = []
    for name, along, height, end in (("tilt", (0, 1, 0), 0.3, 2.0), ("turn", (0, 0, 1), 0.4, 7.0)):
        axes.append(
            ac.PositionerAxis(name=name, axis=along, origin=(0.9, 0, height), lower=-end, upper=end,
                              velocity=1.0, acceleration=1.8)
        )  # fmt: skip
    arm = ac.load_arm("ur10e").with_tool(TOOL).with_work(ac.Frame((0.9, 0, 0.4)))
    return arm.with_positioner(ac.Positioner(axes=tuple(axes), tilt=tilt))


def test_a_missed_angle_to_gravity_is_stated_in_degrees():
    path = ac.Path.polyline(LINE).pointing(AXES)
    hold = -0.0122
    # The turn can bring the tilt of the table toward the tool axis, so their angles subtract.
    cosines = -AXES[:, 2] / np.linalg.norm(AXES, axis=1)
    smallest = np.arccos(cosines).max() - abs(hold)
    enough = table(smallest + np.radians(2)).with_preferences({"tilt": JointPreference(hold=hold)})
    assert reason(path, enough) is None
    allowed = smallest - np.radians(0.3)
    error = reason(path, table(allowed).with_preferences({"tilt": JointPreference(hold=hold)}))
    assert (error.limit, error.joint, error.allowed) == ("hold", 1, hold)
    assert np.radians(0.3) < abs(error.needed) - abs(hold) < np.radians(1.5)
    assert "m away" not in str(error) and "from gravity" in str(error)
    held = JointPreference(hold=error.needed)
    assert reason(path, table(allowed).with_preferences({"tilt": held})) is None


def test_a_tilt_that_no_range_cures_is_the_cause():
    # The tool is level, and the only axis turns about the vertical.
    points = np.array([(0.9, -0.05, 0.5), (0.9, 0.05, 0.5)])
    path = ac.Path.polyline(points).pointing((1, 0, -1))
    turn = ac.PositionerAxis(
        name="turn", axis=(0, 0, 1), origin=(0.9, 0, 0.4), lower=-7.0, upper=7.0, velocity=1.0,
        acceleration=1.8,
    )  # fmt: skip
    arm = ac.load_arm("ur10e").with_tool(TOOL)
    arm = arm.with_positioner(ac.Positioner(axes=(turn,), tilt=np.radians(40)))
    error = reason(path, arm)
    assert error.limit == "tilt" and error.joint is None
    assert error.needed == pytest.approx(np.pi / 4, abs=1e-6)
    assert error.allowed == pytest.approx(np.radians(40))


def test_joints_are_counted_with_the_held_ones():
    rail = ac.Rail(axis=(0, 1, 0), lower=-1.5, upper=1.5, velocity=0.8, acceleration=1.5)
    arm = ac.load_arm("ur10e").with_tool(TOOL).with_rail(rail)
    arm = arm.with_preferences({"rail": JointPreference(hold=0.0)})
    path = ac.Path.polyline([(0.8, -0.2, 0.2), (0.8, 0.2, 0.2)]).pointing((0, 0, -1))
    assert reason(path, arm) is None
    wrist = arm.joint_names.index("wrist_2_joint")
    # With the tool down and the elbow in a vertical plane, this joint is at a right angle.
    error = reason(path, narrow(arm, wrist, -0.1, 0.1))
    assert error.joint == wrist == 5
    assert "joint 6 (wrist_2_joint)" in str(error)


JOB = """
name: seam
arm:
  name: ur10e
  tool: {position: [0, 0, 300 mm]}
  rail: {axis: [0, 1, 0], lower: 0, upper: 3, velocity: 0.8, acceleration: 1.5}
  preferences: {rail: %s}
path: {points: [[700 mm, 0 mm, 200 mm], [700 mm, 3000 mm, 200 mm]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 50 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {}}
"""


@pytest.mark.parametrize(
    ("preference", "limit", "allowed"),
    [("{hold: 200 mm}", "hold", 0.2), ("{range: [0 mm, 900 mm]}", "joint_upper", 0.9)],
)
def test_preferences_of_a_job_are_named(preference, limit, allowed):
    job = parse_job(JOB % preference)
    error = reason(job.program.contours[0].path, job.arm)
    assert (error.limit, error.joint, error.allowed) == (limit, 0, pytest.approx(allowed))
    # At the far end the arm reaches at most 1.5 m beside the rail.
    assert error.needed > 1.5
    word = preference[1:].split(":")[0]
    assert f"`{word}`" in str(error)
    free = parse_job(JOB % "{}")
    assert reason(free.program.contours[0].path, free.arm) is None
