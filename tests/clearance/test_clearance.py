"""Certified distances: bounds hold between samples, and what comes too near is found."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.clearance import check_clearance
from armcontour.errors import Collision, InvalidInput
from armcontour.frames import Frame, exp
from armcontour.motion import LapLaw, Trajectory
from armcontour.scene import (
    ArmShapes,
    Box,
    Capsule,
    HalfSpace,
    LeftOut,
    LinkShape,
    Margins,
    Mesh,
    Obstacle,
    Scene,
    Sphere,
)

UR5E = ac.load_arm("ur5e")
END = LinkShape(name="end", link=6, shape=Sphere(radius=0.03))
BALL = UR5E.with_shapes(ArmShapes(shapes=(END,)))


def sweep_of(first: np.ndarray, last: np.ndarray, duration: float) -> Trajectory:
    """Joints that move evenly from one posture to another."""
    rate = (last - first) / duration
    law = LapLaw(
        breaks=np.array([0.0, duration]),
        q=np.array([first, last]),
        dq=rate[None],
        ddq=np.zeros((1, len(first))),
    )
    return Trajectory(laws=(law,), method="test")


A = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
B = np.array([0.9, -1.0, 1.2, -1.5, -1.3, 0.5])


def test_the_least_distance_is_bracketed() -> None:
    motion = sweep_of(A, B, 1.0)
    middle = BALL.chain  # the ball's centre is the origin of the last link
    assert middle is not None
    plate = Obstacle(name="wall", shape=Sphere(radius=0.05), place=Frame(position=[0.3, 0.5, 0.4]))
    found = check_clearance(motion, BALL, Scene(obstacles=(plate,)), resolution=1e-4)
    (pair,) = found.pairs
    t = np.linspace(0, 1, 20_001)
    centres = BALL.with_tool(Frame()).forward(motion(t))
    # The origin of link 6 is the flange of this arm.
    true = np.linalg.norm(centres - [0.3, 0.5, 0.4], axis=1).min() - 0.08
    assert pair.low <= true <= pair.high <= pair.low + 1.1e-4
    assert found.kept and found.evaluations < 200


def test_a_thin_plate_between_two_samples_is_found() -> None:
    # The ball crosses a plate of 1 mm within less than 4 ms.
    motion = sweep_of(A, A + [1.0, 0, 0, 0, 0, 0], 0.05)
    t = np.arange(0, 0.0501, 0.004)
    centres = BALL.with_tool(Frame()).forward(motion(t))
    here = (centres[5] + centres[6]) / 2
    along = (centres[6] - centres[5]) / np.linalg.norm(centres[6] - centres[5])
    x = np.cross(along, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    place = Frame(position=here, rotation=np.column_stack([x, np.cross(along, x), along]))
    plate = Obstacle(name="plate", shape=Box(size=[0.5, 0.5, 0.001]), place=place)
    small = LinkShape(name="end", link=6, shape=Sphere(radius=0.001))
    arm = UR5E.with_shapes(ArmShapes(shapes=(small,)))
    scene = Scene(obstacles=(plate,), margins=Margins(environment=0.0))
    found = check_clearance(motion, arm, scene)
    # Samples of 4 ms miss the plate.
    distances = np.abs((centres - here) @ along) - 0.0005 - 0.001
    assert (distances > 0.003).all()
    assert not found.kept
    (pair,) = found.too_near
    assert pair.first_time is not None and t[5] < pair.first_time < t[6]
    reached = arm.with_tool(Frame()).forward(motion(np.array([pair.first_time])))[0]
    assert abs((reached - here) @ along) - 0.0015 == pytest.approx(0.0, abs=2e-5)
    with pytest.raises(Collision, match="end and plate touch, first at t = ") as caught:
        found.refuse()
    assert caught.value.t == pair.first_time and caught.value.limit == "clearance"


def test_random_motions_keep_their_bounds_at_random_times() -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(size=(30, 3)) * [0.05, 0.03, 0.1]
    shapes = ArmShapes(
        shapes=(
            LinkShape(name="base", link=0, shape=Capsule(radius=0.07, length=0.1)),
            LinkShape(
                name="upper arm",
                link=2,
                shape=Capsule(radius=0.05, length=0.3),
                place=Frame.rpy([-0.2, 0, 0.1], [0, np.pi / 2, 0]),
            ),
            LinkShape(name="wrist", link=5, shape=Mesh(points=points)),
            LinkShape(name="end", link=6, shape=Sphere(radius=0.03)),
        )
    )
    arm = UR5E.with_shapes(shapes)
    obstacles = (
        Obstacle(name="table", shape=HalfSpace(), place=Frame(position=[0, 0, -0.1])),
        Obstacle(
            name="post", shape=Box(size=[0.1, 0.1, 0.8]), place=Frame(position=[0.4, 0.3, 0.4])
        ),
    )
    scene = Scene(obstacles=obstacles)
    for _ in range(15):
        a = rng.uniform(-2, 2, 6)
        motion = sweep_of(a, a + rng.normal(size=6) * 0.7, 1.0)
        found = check_clearance(motion, arm, scene, resolution=2e-3)
        # One state at a time, at rest: the bracket is then the distance itself.
        for t in rng.uniform(0, 1, 10):
            q = motion(np.array([t]))[0]
            still = check_clearance(sweep_of(q, q, 1.0), arm, scene)
            here = {(x.first, x.second): x.high for x in still.pairs}
            for x in found.pairs:
                assert here[x.first, x.second] >= x.low - 1e-9


def test_the_nearest_pair_of_every_kind_is_told() -> None:
    tip = LinkShape(name="tip", link=6, shape=Sphere(radius=0.01), tool=True)
    upper = LinkShape(name="upper arm", link=2, shape=Sphere(radius=0.05))
    end = LinkShape(name="end", link=5, shape=Sphere(radius=0.05))
    arm = UR5E.with_shapes(ArmShapes(shapes=(upper, end, tip)))
    balls = [
        Obstacle(name=name, shape=Sphere(radius=0.1), place=Frame(position=[x, 3, 0]))
        for name, x in (("near", 0), ("far", 9))
    ]
    found = check_clearance(sweep_of(A, A, 1.0), arm, Scene(obstacles=balls))
    assert {x.kind: x.high for x in found.nearest} == {
        kind: min(x.high for x in found.pairs if x.kind == kind)
        for kind in ("environment", "own", "tool")
    }
    assert found.nearest[0] is found.least
    words = found.sentence
    for x in found.nearest[1:]:
        assert f"{x.second} and {x.first} {x.high * 1e3:.4g} mm" in words
    assert "far" not in words


def test_the_arm_is_no_obstacle_of_its_own_cell() -> None:
    itself = Obstacle(name="end", shape=Sphere(radius=0.05))
    with pytest.raises(InvalidInput, match="end is an obstacle of the scene, and a body of the ar"):
        check_clearance(sweep_of(A, A, 1.0), BALL, Scene(obstacles=(itself,)))


def test_links_without_a_shape_are_named() -> None:
    left = check_clearance(sweep_of(A, A, 1.0), BALL).left_out
    assert [x.first for x in left] == [f"the link after {x}" for x in UR5E.joint_names[:-1]]
    assert {(x.second, x.reason) for x in left} == {("everything", "no shape of it is known")}


def test_what_touches_at_rest_touches_from_the_beginning() -> None:
    here = BALL.with_tool(Frame()).forward(A[None])[0]
    ball = Obstacle(name="ball", shape=Sphere(radius=0.05), place=Frame(position=here))
    (pair,) = check_clearance(sweep_of(A, A, 1.0), BALL, Scene(obstacles=(ball,))).too_near
    assert pair.first_time == 0.0


def test_obstacles_move_with_the_part() -> None:
    ball = Obstacle(
        name="clamp", shape=Sphere(radius=0.02), place=Frame(position=[0.1, 0, 0]), fixed_to="part"
    )
    motion = sweep_of(A, A, 1.0)
    work = Frame(position=[0.5, 0.1, 0.2], rotation=exp(np.array([0.0, 0.0, 0.4])))
    moved = check_clearance(motion, BALL.with_work(work), Scene(obstacles=(ball,)))
    centre = work.position + work.rotation @ [0.1, 0, 0]
    tip = BALL.with_tool(Frame()).forward(A)
    assert moved.pairs[0].high == pytest.approx(np.linalg.norm(tip - centre) - 0.05, abs=1e-6)


def test_pairs_are_left_out_with_reasons() -> None:
    shapes = tuple(
        LinkShape(name=name, link=k, shape=Sphere(radius=0.02))
        for k, name in enumerate(("base", "one", "two", "three"))
    )
    apart = LeftOut(first="base", second="two", reason="given by cell.srdf: Never")
    arm = UR5E.with_shapes(ArmShapes(shapes=shapes, left_out=(apart,)))
    table = Obstacle(name="table", shape=HalfSpace(), place=Frame(position=[0, 0, -1]))
    found = check_clearance(sweep_of(A, A, 1.0), arm, Scene(obstacles=(table,)))
    reasons = {(x.first, x.second): x.reason for x in found.left_out}
    assert reasons[("base", "one")] == "neighbours"
    assert reasons[("base", "two")] == "given by cell.srdf: Never"
    assert reasons[("table", "base")] == "both stand still"
    assert {(x.first, x.second) for x in found.pairs if x.kind == "own"} == {
        ("base", "three"),
        ("one", "three"),
    }


def test_an_arm_without_shapes_is_refused() -> None:
    bare = UR5E.with_shapes(None)
    with pytest.raises(InvalidInput, match="shapes of the links of the arm"):
        check_clearance(sweep_of(A, B, 1.0), bare)
    unknown = Obstacle(name="x", shape=Sphere(radius=0.1), allow=("gripper",))
    with pytest.raises(InvalidInput, match="allows 'gripper' to touch it"):
        check_clearance(sweep_of(A, B, 1.0), BALL, Scene(obstacles=(unknown,)))


def test_a_body_decides_where_its_hull_comes_too_near() -> None:
    # A frame of four bars, whose hull is a full plate, around the ball.
    bars = [((-0.2, 0, 0), (0.02, 0.4, 0.02)), ((0.2, 0, 0), (0.02, 0.4, 0.02))]
    bars += [((0, -0.2, 0), (0.4, 0.02, 0.02)), ((0, 0.2, 0), (0.4, 0.02, 0.02))]
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]]
        + [[0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )
    points = np.concatenate([corners * size + centre for centre, size in bars])
    triangles = np.concatenate([faces + 8 * k for k in range(len(bars))])
    tip = BALL.with_tool(Frame()).forward(A)
    frame = Obstacle(
        name="frame", shape=Mesh(points=points, triangles=triangles), place=Frame(position=tip)
    )
    found = check_clearance(sweep_of(A, A, 1.0), BALL, Scene(obstacles=(frame,)))
    assert found.kept
    assert found.pairs[0].high == pytest.approx(0.19 - 0.03, abs=1e-6)
    hull = Obstacle(name="hull", shape=Mesh(points=points), place=Frame(position=tip))
    assert not check_clearance(sweep_of(A, A, 1.0), BALL, Scene(obstacles=(hull,))).kept
