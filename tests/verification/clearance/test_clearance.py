"""Clearance of motions, distances between bodies, and ways around obstacles."""

import itertools

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core.errors import Collision, InvalidInput
from armcontour.core.frames import Frame, exp
from armcontour.motion import LapLaw, Trajectory
from armcontour.robot import scene as cell
from armcontour.robot.scene import ArmShapes, LinkShape, Margins, Mesh, Obstacle, Scene, Sphere
from armcontour.verification.clearance import Cell, check_clearance

pytestmark = needs_dynamics

UR5E = ac.load_arm("ur5e")
END = LinkShape(name="end", link=6, shape=Sphere(radius=0.03))
BALL = UR5E.with_shapes(ArmShapes(shapes=(END,)))


def sweep_of(first, last, duration):
    """Joints that move evenly from one posture to another."""
    rate = (last - first) / duration
    law = LapLaw(
        breaks=np.array([0.0, duration]),
        q=np.array([first, last]),
        dq=rate[None],
        ddq=np.zeros((1, len(first))),
    )
    return Trajectory(laws=(law,), method="test")


def ball(name, radius, position, **more):
    return Obstacle(name=name, shape=Sphere(radius=radius), place=Frame(position=position), **more)


def tip(q, arm=BALL):
    """The origin of link 6, the flange of this arm."""
    return arm.with_tool(Frame()).tool_position(q)


A = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
B = np.array([0.9, -1.0, 1.2, -1.5, -1.3, 0.5])


def test_the_smallest_distance_is_between_the_stated_bounds():
    motion = sweep_of(A, B, 1.0)
    scene = Scene(obstacles=(ball("wall", 0.05, [0.3, 0.5, 0.4]),))
    clearance = check_clearance(motion, BALL, scene, resolution=1e-4)
    (pair,) = clearance.pairs
    centres = tip(motion(np.linspace(0, 1, 20_001)))
    true = np.linalg.norm(centres - [0.3, 0.5, 0.4], axis=1).min() - 0.08
    assert pair.low <= true <= pair.high <= pair.low + 1.1e-4
    assert clearance.satisfied and clearance.evaluations < 200


@pytest.mark.parametrize("more", [0.0, 1e-9, -1e-9, 1e-6])
def test_distance_equal_to_the_margin_along_a_rail_is_decided_at_once(more):
    # Only the rail moves, so the distance is constant. It is within the uncertainty of distances.
    rail = ac.Rail(axis=(0, 1, 0), lower=-2, upper=2, velocity=1, acceleration=2)
    end = LinkShape(name="end", link=7, shape=Sphere(radius=0.03))
    arm = UR5E.with_rail(rail).with_shapes(ArmShapes(shapes=(end,)))
    first = np.append(-2.0, A)
    last = np.append(2.0, A)
    x, _, z = tip(first, arm)
    margin = 0.01
    place = Frame(position=[x, 0, z - 0.03 - 0.05 - margin - more])
    table = Obstacle(name="table", shape=cell.Box(size=[2, 8, 0.1]), place=place)
    scene = Scene(obstacles=(table,), margins=Margins(environment=margin))
    clearance = check_clearance(sweep_of(first, last, 4.0), arm, scene)
    (pair,) = clearance.pairs
    assert not clearance.satisfied
    assert pair.first_time == 0.0
    assert pair.high == pytest.approx(margin + more, abs=1e-10)
    assert clearance.evaluations < 10_000
    assert not Cell(arm, scene).keeps(sweep_of(first, last, 4.0))


def test_a_thin_plate_between_two_samples_is_found():
    # The ball crosses a plate of 1 mm within less than 4 ms.
    motion = sweep_of(A, A + [1.0, 0, 0, 0, 0, 0], 0.05)
    t = np.arange(0, 0.0501, 0.004)
    centres = tip(motion(t))
    center = (centres[5] + centres[6]) / 2
    along = (centres[6] - centres[5]) / np.linalg.norm(centres[6] - centres[5])
    x = np.cross(along, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    place = Frame(position=center, rotation=np.column_stack([x, np.cross(along, x), along]))
    plate = Obstacle(name="plate", shape=cell.Box(size=[0.5, 0.5, 0.001]), place=place)
    small = LinkShape(name="end", link=6, shape=Sphere(radius=0.001))
    arm = UR5E.with_shapes(ArmShapes(shapes=(small,)))
    scene = Scene(obstacles=(plate,), margins=Margins(environment=0.0))
    clearance = check_clearance(motion, arm, scene)
    # Samples of 4 ms miss the plate.
    distances = np.abs((centres - center) @ along) - 0.0005 - 0.001
    assert (distances > 0.003).all()
    assert not clearance.satisfied
    (pair,) = clearance.too_near
    assert pair.first_time is not None and t[5] < pair.first_time < t[6]
    reached = tip(motion(np.array([pair.first_time])), arm)[0]
    assert abs((reached - center) @ along) - 0.0015 == pytest.approx(0.0, abs=2e-5)
    with pytest.raises(Collision, match="end and plate touch, first at t = ") as caught:
        clearance.refuse()
    assert caught.value.t == pair.first_time and caught.value.limit == "clearance"


def test_random_motions_keep_their_bounds_at_random_times():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(30, 3)) * [0.05, 0.03, 0.1]
    shapes = ArmShapes(
        shapes=(
            LinkShape(name="base", link=0, shape=cell.Capsule(radius=0.07, length=0.1)),
            LinkShape(
                name="upper arm",
                link=2,
                shape=cell.Capsule(radius=0.05, length=0.3),
                place=Frame.rpy([-0.2, 0, 0.1], [0, np.pi / 2, 0]),
            ),
            LinkShape(name="wrist", link=5, shape=Mesh(points=points)),
            LinkShape(name="end", link=6, shape=Sphere(radius=0.03)),
        )
    )
    arm = UR5E.with_shapes(shapes)
    post = Frame(position=[0.4, 0.3, 0.4])
    table = Obstacle(name="table", shape=cell.HalfSpace(), place=Frame(position=[0, 0, -0.1]))
    post = Obstacle(name="post", shape=cell.Box(size=[0.1, 0.1, 0.8]), place=post)
    scene = Scene(obstacles=(table, post))
    for _ in range(10):
        a = rng.uniform(-2, 2, 6)
        motion = sweep_of(a, a + rng.normal(size=6) * 0.7, 1.0)
        clearance = check_clearance(motion, arm, scene, resolution=2e-3)
        # At rest, both bounds are the distance itself.
        for t in rng.uniform(0, 1, 10):
            q = motion(np.array([t]))[0]
            still = check_clearance(sweep_of(q, q, 1.0), arm, scene)
            distances_at_rest = {(x.first, x.second): x.high for x in still.pairs}
            for x in clearance.pairs:
                assert distances_at_rest[x.first, x.second] >= x.low - 1e-9
        first = min((x.first_time for x in clearance.too_near), default=np.inf)
        assert Cell(arm, scene).first_violation(motion) == pytest.approx(first, abs=1e-4)


def test_the_nearest_pair_of_every_kind_is_reported():
    tip = LinkShape(name="tip", link=6, shape=Sphere(radius=0.01), tool=True)
    upper = LinkShape(name="upper arm", link=2, shape=Sphere(radius=0.05))
    end = LinkShape(name="end", link=5, shape=Sphere(radius=0.05))
    arm = UR5E.with_shapes(ArmShapes(shapes=(upper, end, tip)))
    balls = ball("near", 0.1, [0, 3, 0]), ball("far", 0.1, [9, 3, 0])
    clearance = check_clearance(sweep_of(A, A, 1.0), arm, Scene(obstacles=balls))
    assert {x.kind: x.high for x in clearance.nearest} == {
        kind: min(x.high for x in clearance.pairs if x.kind == kind)
        for kind in ("environment", "own", "tool")
    }
    assert clearance.nearest[0] is clearance.least


def test_distance_of_nearest_obstacle_is_accurate_although_other_pairs_are_nearer():
    tip = LinkShape(name="tip", link=6, shape=Sphere(radius=0.01), tool=True)
    close = LinkShape(name="close", link=4, shape=Sphere(radius=0.05))
    arm = UR5E.with_shapes(ArmShapes(shapes=(close, tip)))
    motion = sweep_of(A, B, 1.0)
    scene = Scene(obstacles=(ball("wall", 0.05, [0.3, 0.7, 0.4]),))
    clearance = check_clearance(motion, arm, scene, resolution=1e-4)
    pairs = {x.bodies: x for x in clearance.pairs if "wall" in x.bodies and x.kind == "tool"}
    (pair,) = pairs.values()
    assert clearance.least.high < pair.low
    assert pair.high <= pair.low + 1.1e-4


def test_missing_shapes_contacts_at_rest_and_obstacles_on_the_part_count():
    ignored = check_clearance(sweep_of(A, A, 1.0), BALL).left_out
    assert [x.first for x in ignored] == [f"the link after {x}" for x in UR5E.joint_names[:-1]]
    assert {(x.second, x.reason) for x in ignored} == {("everything", "no shape of it is known")}
    scene = Scene(obstacles=(ball("ball", 0.05, tip(A)),))
    (pair,) = check_clearance(sweep_of(A, A, 1.0), BALL, scene).too_near
    assert pair.first_time == 0.0
    scene = Scene(obstacles=(ball("clamp", 0.02, [0.1, 0, 0], fixed_to="part"),))
    work = Frame(position=[0.5, 0.1, 0.2], rotation=exp(np.array([0.0, 0.0, 0.4])))
    moved = check_clearance(sweep_of(A, A, 1.0), BALL.with_work(work), scene)
    centre = work.position + work.rotation @ [0.1, 0, 0]
    true = np.linalg.norm(tip(A) - centre) - 0.05
    assert moved.pairs[0].high == pytest.approx(true, abs=1e-6)


def test_each_ignored_pair_has_its_reason():
    shapes = tuple(
        LinkShape(name=name, link=k, shape=Sphere(radius=0.02))
        for k, name in enumerate(("base", "one", "two", "three"))
    )
    apart = cell.LeftOut(first="base", second="two", reason="given by cell.srdf: Never")
    arm = UR5E.with_shapes(ArmShapes(shapes=shapes, left_out=(apart,)))
    table = Obstacle(name="table", shape=cell.HalfSpace(), place=Frame(position=[0, 0, -1]))
    clearance = check_clearance(sweep_of(A, A, 1.0), arm, Scene(obstacles=(table,)))
    reasons = {(x.first, x.second): x.reason for x in clearance.left_out}
    assert reasons[("base", "one")] == "neighbours"
    assert reasons[("base", "two")] == "given by cell.srdf: Never"
    assert reasons[("table", "base")] == "both are fixed"
    assert {(x.first, x.second) for x in clearance.pairs if x.kind == "own"} == {
        ("base", "three"),
        ("one", "three"),
    }


def test_invalid_scenes_are_refused(refuses):
    motion = sweep_of(A, B, 1.0)
    itself = ball("end", 0.05, [0, 0, 0])
    unknown = ball("x", 0.1, [0, 0, 0], allow=("gripper",))
    refuses(lambda: check_clearance(motion, UR5E.with_shapes(None)), InvalidInput, "shapes")
    for obstacle, words in ((itself, "end is an obstacle"), (unknown, "Write end")):
        scene = Scene(obstacles=(obstacle,))
        refuses(lambda x=scene: check_clearance(motion, BALL, x), InvalidInput, words)


def test_a_mesh_is_checked_if_its_convex_hull_is_too_near():
    # A frame of four bars, whose hull is a full plate, around the ball.
    bars = [((-0.2, 0, 0), (0.02, 0.4, 0.02)), ((0.2, 0, 0), (0.02, 0.4, 0.02))]
    bars += [((0, -0.2, 0), (0.4, 0.02, 0.02)), ((0, 0.2, 0), (0.4, 0.02, 0.02))]
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]]
        + [[0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )
    points = np.concatenate([corners * size + centre for centre, size in bars])
    triangles = np.concatenate([faces + 8 * k for k in range(len(bars))])
    place = Frame(position=tip(A))
    full = Obstacle(name="frame", shape=Mesh(points=points, triangles=triangles), place=place)
    hull = Obstacle(name="hull", shape=Mesh(points=points), place=place)
    full_clearance, near = (
        check_clearance(sweep_of(A, A, 1.0), BALL, Scene(obstacles=(x,))) for x in (full, hull)
    )
    assert full_clearance.satisfied and not near.satisfied
    assert full_clearance.pairs[0].high == pytest.approx(0.19 - 0.03, abs=1e-6)


def test_links_below_the_base_are_named_with_their_depth():
    # The ball of 30 mm at the flange; its lowest place by a dense look of our own.
    down = A + [0, 1.1, 0, 0, 0, 0]
    motion = sweep_of(A, down, 1.0)
    t = np.linspace(0, 1, 20_001)
    height = tip(motion(t))[:, 2] - 0.03
    assert height[0] > 0.1 and height.min() < -0.2
    clearance = check_clearance(motion, BALL, resolution=1e-4)
    (below,) = clearance.below
    assert (below.second, clearance.satisfied) == ("end", True)
    assert below.high == pytest.approx(height.min(), abs=1e-4)
    assert below.t == pytest.approx(t[height.argmin()], abs=0.05)
    # The margin of 1 mm is passed at the first time.
    assert below.first_time == pytest.approx(t[np.argmax(height < -1e-3)], abs=1e-3)
    assert "end goes" in clearance.below_base and clearance.later(2.0).below[0].t == below.t + 2.0
    above = check_clearance(sweep_of(A, A + [1.0, 0, 0, 0, 0, 0], 1.0), BALL)
    assert above.below == () and above.below_base is None


def test_only_a_scene_without_a_floor_has_the_plane_of_the_base():
    motion = sweep_of(A, A + [0, 1.1, 0, 0, 0, 0], 1.0)

    def plane(position, turn):
        place = Frame(position=position, rotation=exp(np.array([turn, 0, 0])))
        return Obstacle(name="plane", shape=cell.HalfSpace(), place=place, allow=("end",))

    wall = plane([0, 2, 0], np.pi / 2)
    table = plane([0, 0, -2.0], 0.0)
    for scene, is_below in (
        (Scene(), True),
        (Scene(obstacles=(wall,)), True),
        (Scene(obstacles=(table,)), False),
        (Scene(floor="none"), False),
        (Scene(floor=-2), False),
    ):
        assert bool(check_clearance(motion, BALL, scene).below) == is_below
    for floor in ("table", np.nan, None):
        with pytest.raises(InvalidInput, match="floor"):
            Scene(floor=floor)
    with pytest.raises(InvalidInput, match="floor"):
        Scene(obstacles=(ball("floor", 0.1, [1, 0, 0]),), floor=0.0)
