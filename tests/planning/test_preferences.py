"""Preferences in plans: joints that are held or still, ranges, weights, and what is preferred."""

import itertools

import numpy as np
import pytest
from tests.planning import cells

import armcontour as ac
from armcontour.robot import ArmMismatch, JointPreference

STILL = {x: JointPreference(still=True) for x in ("gx", "gy")}


@pytest.fixture(scope="module")
def gantry(tmp_path_factory):
    return cells.from_description(tmp_path_factory.mktemp("gantry"), gantry=True, table=False)


def positions(motion, n=400):
    return motion(np.linspace(0.0, motion.duration, n))


def tool_of_gantry(q):
    """Tool poses of the gantry, by own kinematics."""
    slid = cells.shifts(np.column_stack([q[:, :2], np.zeros(len(q))]))
    return cells.tool_poses(slid @ cells.HUNG.homogeneous, q[:, 2:])


def tool_on_rail(q):
    """Tool poses of the arm on its rail, by own kinematics."""
    slid = cells.shifts(np.outer(q[:, 0], [0.0, 1.0, 0.0]))
    return cells.tool_poses(slid, q[:, 1:])


def check_path(path, poses):
    """The tool is on the path, with its axis downwards."""
    assert path.project(poses[:, :3, 3]).distance.max() < 1e-8
    np.testing.assert_allclose(poses[:, :3, 2], np.tile(cells.DOWN, (len(poses), 1)), atol=1e-8)


def circles():
    """Circles on a plate: two next to each other, the others metres away."""
    places = ((2.5, 1.5), (2.6, 1.5), (4.5, 1.5), (1.0, 0.6))
    return [cells.circle(x, y, 0.8) for x, y in places]


def moves_of(paths, between):
    """Contours with other moves between them."""
    moves = [ac.Contour(paths[0])]
    for before, path in itertools.pairwise(paths):
        moves += [*between(before, path), ac.Contour(path)]
    return ac.Program(moves=tuple(moves))


def lifted(before, path):
    """A rapid with a path: up, over and down."""
    up = np.array([0.0, 0.0, 0.1])
    end = before(before.length)
    start = path(0.0)
    return [ac.Rapid(path=ac.Path.polyline([end, end + up, start + up, start]))]


PROGRAMS = {
    "joint motions": lambda: moves_of(circles(), lambda *_: [ac.Rapid()]),
    "rapids with a path": lambda: moves_of(circles(), lifted),
    "approaches": lambda: ac.prepare(
        moves_of(circles(), lambda *_: [ac.Rapid()]), ac.Process(approach=0.05, retract=0.05)
    ),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_still_joints_move_between_contours_only(gantry, name):
    program = PROGRAMS[name]()
    arm = gantry.with_preferences(STILL)
    motion = ac.plan(program, arm, arm.limits.replace(speed=0.06))
    places = []
    contours = iter(program.contours)
    for span in motion.spans:
        if span.trajectory is None:
            continue
        q = positions(span.trajectory)
        if span.kind == "contour":
            assert (np.ptp(q[:, :2], axis=0) == 0.0).all()
            check_path(next(contours).path, tool_of_gantry(q))
            places.append(q[0, :2])
    # The gantry follows the contours that the arm cannot reach from one place.
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert (moved[1:] > 0.5).all()
    limits = arm.limits
    dq = motion(np.linspace(0, motion.duration, 4000), 1)
    assert (np.abs(dq) / limits.joint_velocity).max() < 1 + 1e-9


@pytest.mark.parametrize("name", ["rapids with a path", "approaches"])
def test_tool_follows_the_rapids_of_an_arm_with_still_joints(gantry, name):
    program = PROGRAMS[name]()
    arm = gantry.with_preferences(STILL)
    motion = ac.plan(program, arm, arm.limits.replace(speed=0.06))
    lines = [x.path for x in program.moves if isinstance(x, ac.Rapid) and x.path is not None]
    along = 0
    for span in motion.spans:
        if span.kind == "rapid" and span.trajectory is not None:
            poses = tool_of_gantry(positions(span.trajectory))
            if any(x.project(poses[:, :3, 3]).distance.max() < 1e-8 for x in lines):
                along += 1
    assert along == len(lines)


def test_still_rail_serves_contours_within_reach_from_one_place():
    arm = cells.on_rail().with_preferences({"rail": JointPreference(still=True)})
    paths = [cells.circle(0.8, y, 0.1) for y in (1.0, 1.15)]
    program = moves_of(paths, lambda *_: [ac.Rapid()])
    motion = ac.plan(program, arm, arm.limits.replace(speed=0.06))
    assert np.ptp(positions(motion, 2000)[:, 0]) == 0.0
    for path, span in zip(paths, motion.contour_spans, strict=True):
        check_path(path, tool_on_rail(positions(span.trajectory)))


def test_seed_keeps_a_still_joint_where_it_is():
    arm = cells.on_rail().with_preferences({"rail": JointPreference(still=True)})
    path = cells.circle(0.8, 1.0, 0.1)
    free = ac.trace(path, arm)
    moved = free(0.0)
    moved[0] += 0.1
    held = cells.on_rail().with_preferences({"rail": JointPreference(hold=float(moved[0]))})
    seed = ac.trace(path, held, seed=moved)(0.0)
    again = ac.trace(path, arm, seed=seed)
    assert (again(np.linspace(0, again.length, 50))[:, 0] == seed[0]).all()


def test_contour_that_needs_a_still_joint_is_refused_with_its_name():
    arm = cells.on_rail().with_preferences({"rail": JointPreference(still=True)})
    ac.trace(cells.seam(), cells.on_rail())
    with pytest.raises(ac.Unreachable, match="rail stays at"):
        ac.plan(cells.seam(), arm, arm.limits.replace(speed=0.02))


@pytest.mark.parametrize("hold", [0.7, 1.1])
def test_held_rail_does_not_move(hold):
    arm = cells.on_rail().with_preferences({"rail": JointPreference(hold=hold)})
    path = cells.circle(0.8, 1.0, 0.1)
    q = positions(ac.plan(path, arm, arm.limits.replace(speed=0.06)))
    assert (q[:, 0] == hold).all()
    check_path(path, tool_on_rail(q))


def test_joint_of_the_arm_itself_is_held():
    line = ac.Path.polyline([(0.6, -0.1, 0.3), (0.6, 0.1, 0.3)]).pointing(cells.DOWN)
    arm = ac.load_arm("ur10e").with_preferences({"wrist_3_joint": JointPreference(hold=0.4)})
    q = positions(ac.plan(line, arm, arm.limits.replace(speed=0.05)))
    assert (q[:, 5] == 0.4).all()
    bare = ac.load_arm("fr3")
    flat = ac.Path.polyline([(0.5, -0.1, 0.3), (0.5, 0.1, 0.3)]).oriented(
        np.diag([1.0, -1.0, -1.0])
    )
    seven = bare.with_preferences({bare.joint_names[2]: JointPreference(hold=0.2)})
    q = positions(ac.plan(flat, seven, seven.limits.replace(speed=0.05)))
    assert (q[:, 2] == 0.2).all()


def test_held_joint_that_the_path_needs_is_the_reason():
    down = np.diag([1.0, -1.0, -1.0])
    line = ac.Path.polyline([(0.6, -0.1, 0.3), (0.6, 0.1, 0.3)]).oriented(down)
    arm = ac.load_arm("ur10e").with_preferences({"elbow_joint": JointPreference(hold=1.0)})
    with pytest.raises(ArmMismatch, match="elbow_joint at 1 rad") as error:
        ac.plan(line, arm, arm.limits.replace(speed=0.05))
    assert error.value.joint == 2


def test_preferred_range_is_kept_along_the_path():
    path = cells.seam(length=1.2, first=0.9)
    free = cells.on_rail()
    q = positions(ac.plan(path, free, free.limits.replace(speed=0.1)))
    low, high = q[:, 0].min(), q[:, 0].max()
    ends = float((low + high) / 2), float(high + 0.3)
    arm = free.with_preferences({"rail": JointPreference(range=ends)})
    q = positions(ac.plan(path, arm, arm.limits.replace(speed=0.1)))
    assert q[:, 0].min() >= ends[0] - 1e-9
    assert q[:, 0].max() <= ends[1] + 1e-9
    poses = tool_on_rail(q)
    assert path.project(poses[:, :3, 3]).distance.max() < 1e-8


def weighted_motion(arm, q):
    """Sum of the weighted joint steps, each relative to the joint's largest velocity."""
    pace = np.array(arm.chain.weights) / arm.limits.joint_velocity
    return (np.linalg.norm(np.diff(q, axis=0) * pace, axis=1)).sum()


def test_fastest_is_never_slower_and_least_motion_never_moves_more():
    path = cells.zigzag()
    bare = cells.on_rail()
    found = {}
    for prefer in (None, "fastest", "least motion"):
        arm = bare.with_preferences({"rail": JointPreference(weight=3.0)}, prefer=prefer)
        motion = ac.plan(path, arm, arm.limits.replace(speed=1.0))
        found[prefer] = motion.duration, weighted_motion(arm, positions(motion, 4000))
    durations = [x for x, _ in found.values()]
    motions = [x for _, x in found.values()]
    assert found["fastest"][0] <= min(durations) * (1 + 1e-4)
    assert found["least motion"][1] <= min(motions) * 1.01


def test_resumed_contour_keeps_the_position_of_a_still_joint(gantry):
    arm = gantry.with_preferences(STILL)
    path = cells.circle(2.5, 1.5, 0.8)
    limits = arm.limits.replace(speed=0.06)
    whole = ac.plan(path, arm, limits)
    q = positions(whole)
    assert (np.ptp(q[:, :2], axis=0) == 0.0).all()
    again = ac.plan(path, arm, limits, ac.Optimal(seed=q[0]))
    np.testing.assert_allclose(positions(again)[:, :2], q[:, :2], atol=1e-12)
    assert again.duration == pytest.approx(whole.duration, rel=1e-6)


def test_arm_without_preferences_is_traced_as_before():
    arm = cells.on_rail()
    path = cells.circle(0.8, 1.0, 0.1)
    same = arm.with_preferences({"rail": JointPreference(weight=1.0)})
    first, second = (ac.trace(path, x).coefficients for x in (arm, same))
    np.testing.assert_array_equal(first, second)
