"""Distances from boxes and half-spaces, compared with formulas and with the library."""

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame, exp
from armcontour.robot.scene import (
    ArmShapes,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    LinkShape,
    Mesh,
    Obstacle,
    Scene,
    Sphere,
)
from armcontour.verification.clearance.body_pairs import UNCERTAINTY, Distances, pairs_of
from armcontour.verification.clearance.flat_faces import face_distances

UP = np.eye(3)
CORNERS = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.1, 0], [0, 0, 0.3], [0.2, 0.1, 0.3]])
BODIES = {
    "sphere": Sphere(0.05),
    "capsule": Capsule(0.02, 0.1),
    "cylinder": Cylinder(0.03, 0.1),
    "box": Box([0.02, 0.05, 0.1]),
    "mesh": Mesh(CORNERS),
}
TABLE = Box([2.0, 2.0, 0.1])


def at(rotation, position):
    """One placement as arrays."""
    return np.array([rotation]), np.array([position], dtype=float)


def heights(body, rotation):
    """Lowest and highest z of a body at the origin, from its definition [m]."""
    x, y, z = np.asarray(rotation)[2]
    half = {
        Sphere: lambda: body.radius,
        Capsule: lambda: body.radius + abs(z) * body.length / 2,
        Cylinder: lambda: body.radius * np.sqrt(max(0, 1 - z**2)) + abs(z) * body.length / 2,
        Box: lambda: np.abs([x, y, z]) @ body.size / 2,
    }
    if isinstance(body, Mesh):
        z = [float(np.dot(rotation[2], corner)) for corner in body.points]
        return min(z), max(z)
    h = half[type(body)]()
    return -h, h


@pytest.mark.parametrize("name", BODIES)
def test_distance_above_and_below_a_table_is_that_of_the_nearest_height(name):
    body = BODIES[name]
    measured = face_distances(TABLE, body)
    floor = face_distances(HalfSpace(), body)
    for turn in ([0, 0, 0], [0.3, -0.8, 0.1], [np.pi / 2, 0, 0], [0, np.pi, 0]):
        rotation = exp(np.array(turn, dtype=float))
        low, high = heights(body, rotation)
        above = measured.measure(*at(rotation, [0.1, -0.2, 0.6]))
        assert above == pytest.approx(0.6 + low - 0.05, abs=1e-14)
        below = measured.measure(*at(rotation, [0.1, -0.2, -0.6]))
        assert below == pytest.approx(0.6 - high - 0.05, abs=1e-14)
        # A body in the floor has a negative distance.
        for z in (0.6, -0.1):
            in_floor = floor.measure(*at(rotation, [5.0, -9.0, z]))
            assert in_floor == pytest.approx(z + low, abs=1e-14)


@pytest.mark.parametrize("name", BODIES)
def test_places_without_a_nearest_point_on_a_face_are_not_measured(name):
    measured = face_distances(TABLE, BODIES[name])
    beside_edge = [1.3, 1.4, 0.6]
    inside = [0.0, 0.0, 0.0]
    assert np.isnan(measured.measure(*at(UP, beside_edge)))
    assert np.isnan(measured.measure(*at(UP, inside)))


def test_pairs_without_a_flat_face_and_two_half_spaces_are_not_measured():
    assert face_distances(Sphere(0.1), BODIES["mesh"]) is None
    assert face_distances(HalfSpace(), HalfSpace()) is None
    with pytest.raises(InvalidInput):
        HalfSpace().farthest(np.eye(3))


@needs_dynamics
def test_many_places_have_the_distances_that_the_library_measures_one_by_one():
    arm = ac.load_arm("ur5e")
    tools = [
        LinkShape(name=name, link=6, shape=body, place=Frame((0.1 * k - 0.2, 0, 0.1)), tool=True)
        for k, (name, body) in enumerate(BODIES.items())
    ]
    arm = arm.with_shapes(ArmShapes(shapes=(*arm.shapes.shapes, *tools)))
    turned = Frame((0.5, 0.1, 0.2), rotation=exp(np.array([0.4, -0.3, 0.9])))
    obstacles = (
        Obstacle(name="crate", shape=Box([0.3, 0.5, 0.2]), place=turned),
        Obstacle(name="plate", shape=Box([1.5, 1.5, 0.02]), place=Frame((0, 0, -0.2))),
    )
    pairs, _ = pairs_of(arm, Scene(obstacles, floor=-0.3))
    distances = Distances(arm.chain, pairs)
    q = np.random.default_rng(3).uniform(-2.5, 2.5, (60, 6))
    closed = 0
    for k, pair in enumerate(pairs):
        states = np.arange(len(q))
        together = distances.measure(q, states, np.full(len(q), k))
        # The library measures single places.
        alone = [distances.measure(q, states[i : i + 1], np.array([k]))[0] for i in states]
        np.testing.assert_allclose(together, alone, rtol=0, atol=1.5 * UNCERTAINTY)
        closed += face_distances(pair.first.shape, pair.second.shape) is not None
    assert closed >= 30


@needs_dynamics
def test_a_mesh_whose_hull_is_too_near_a_plate_is_measured_exactly():
    # The lowest corner belongs to the hull only.
    points = np.array([[0, 0, 0], [0.1, 0, 0.1], [0, 0.1, 0.1], [-0.1, -0.1, 0.1], [0, 0, 0.2]])
    triangles = np.array([[1, 2, 4], [2, 3, 4], [3, 1, 4], [1, 3, 2]])
    whole = Mesh(points, triangles=triangles)
    body = LinkShape(name="body", link=6, shape=whole.hull, exact=whole)
    arm = ac.load_arm("ur5e").with_shapes(ArmShapes(shapes=(body,))).with_tool(Frame())
    pose = np.array([0.0, -1.2, 1.5, -1.8, 1.57, 0.0])
    flange = arm.poses(pose[None])[0]
    lowest = (points @ flange[:, :3].T + flange[:, 3])[:, 2]
    assert lowest.min() == pytest.approx(lowest[0])
    plate = Frame((*flange[:2, 3], lowest[0] - 1e-3 - 0.01))
    scene = Scene((Obstacle(name="plate", shape=Box([2.0, 2.0, 0.02]), place=plate),))
    pairs, _ = pairs_of(arm, scene)
    places = np.zeros(50, dtype=np.intp)
    distances = Distances(arm.chain, pairs).measure(pose[None], places, places)
    assert distances == pytest.approx(lowest[1:].min() - (lowest[0] - 1e-3), abs=UNCERTAINTY)
