"""Motions with certified clearance touch nothing, and MuJoCo confirms contacts.

Random motions of three arms between random obstacles are checked. If a motion is certified clear,
its bodies are examined at 100 times as many random times, with other kinematics (scipy's rotations)
and with triangles instead of hulls. Random postures are also given to MuJoCo, which has its own
kinematics and collisions. If only one of the programs says that two bodies touch, their distance
must be at most EXCESS.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import coal
import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.core.frames import Frame
from armcontour.motion import LapLaw, Trajectory
from armcontour.robot import Chain
from armcontour.robot.scene import (
    Box,
    Capsule,
    Cylinder,
    LinkShape,
    Mesh,
    Obstacle,
    Scene,
    Shape,
    Sphere,
)
from armcontour.verification.clearance.body_pairs import Distances, Pair, pairs_of
from soak import Outcome

ARMS = ("ur5e", "ur10e", "panda")
FINER = 100
POSTURES = 50  # given to MuJoCo per seed
# Laps of a random motion, each with a uniform acceleration.
LAPS = 4
# Duration of a lap [s].
LAP = 0.3
# Largest distance between bodies that touch for only one of two programs [m], due to tolerances.
EXCESS = 5e-6
FloatArray = npt.NDArray[np.float64]


@dataclass(kw_only=True)
class Tally:
    """What was found: motions, those certified clear, looks at those, touches among them."""

    motions: int = 0
    clear: int = 0
    looks: int = 0
    touches: int = 0


def random_motion(arm: ac.Arm, rng: np.random.Generator) -> Trajectory:
    """Draw laps of random accelerations from a random posture."""
    limits = arm.limits.for_joints(arm.dof)
    assert limits.joint_velocity is not None
    low, high = (np.clip(x, -np.pi, np.pi) for x in (limits.joint_lower, limits.joint_upper))
    q = [rng.uniform(low, high)]
    dq = [np.zeros(arm.dof)]
    ddq = rng.uniform(-1, 1, (LAPS, arm.dof)) * limits.joint_velocity / (2 * LAP)
    for x in ddq:
        q.append(q[-1] + LAP * dq[-1] + LAP**2 / 2 * x)
        dq.append(dq[-1] + LAP * x)
    breaks = LAP * np.arange(LAPS + 1)
    law = LapLaw(breaks=breaks, q=np.array(q), dq=np.array(dq[:-1]), ddq=ddq)
    return Trajectory(laws=(law,), method="random")


def random_scene(rng: np.random.Generator) -> Scene:
    """Draw some bodies around an arm."""
    obstacles = []
    for k in range(int(rng.integers(1, 5))):
        way = rng.normal(size=3)
        place = Frame(
            position=way / np.linalg.norm(way) * rng.uniform(0.4, 1.1),
            rotation=Rotation.random(None, rng).as_matrix(),
        )
        obstacles.append(Obstacle(name=f"body {k}", shape=random_shape(rng), place=place))
    return Scene(obstacles=tuple(obstacles))


def random_shape(rng: np.random.Generator) -> Shape:
    """Draw a body of a random kind and size, also thin plates."""
    a, b, c = rng.uniform(0.02, 0.2, 3)
    match int(rng.integers(6)):
        case 0:
            return Sphere(radius=a)
        case 1:
            return Capsule(radius=a / 2, length=b)
        case 2:
            return Cylinder(radius=a / 2, length=b)
        case 3:
            return Box(size=np.array([a, b, c]))
        case 4:
            return Box(size=np.array([2 * a, 2 * b, 0.001]))
    points = rng.normal(size=(12, 3)) * [a, b, c]
    return Mesh(points=points, triangles=ConvexHull(points).simplices)


class Judge:
    """Touches of pairs by triangles and by other kinematics."""

    def __init__(self, chain: Chain, pairs: tuple[Pair, ...]) -> None:
        self._chain = chain
        both = [(pair.first, pair.second) for pair in pairs]
        bodies = {id(x): x for pair in both for x in pair}
        order = {key: k for k, key in enumerate(bodies)}
        self._bodies = [(x.link, *_body(x)) for x in bodies.values()]
        self._pairs = np.array([[order[id(x)] for x in pair] for pair in both])
        balls = [_ball(shape) for _, shape, _ in self._bodies]
        self._centres = np.array([np.append(centre, 1.0) for centre, _ in balls])
        self._radii = np.array([radius for _, radius in balls])

    def touches(self, q: FloatArray) -> int:
        """Count the pairs that touch at joint positions, (n, dof), over all postures.

        Bodies whose balls are apart do not touch; all others are looked at by their triangles.
        """
        links = self.poses(q)
        placed = np.stack([links[link] @ place for link, _, place in self._bodies], axis=1)
        centres = np.einsum("nbij,bj->nbi", placed, self._centres)[..., :3]
        first, second = self._pairs.T
        between = np.linalg.norm(centres[:, first] - centres[:, second], axis=2)
        near = between <= (self._radii[first] + self._radii[second]) * (1 + 1e-9)
        request = coal.CollisionRequest()
        count = 0
        for k, pair in np.argwhere(near).tolist():
            shapes = []
            places = []
            for body in self._pairs[pair].tolist():
                pose = placed[k, body]
                shapes.append(self._bodies[body][1])
                places.append(coal.Transform3s(pose[:3, :3], pose[:3, 3]))
            collision = coal.CollisionResult()
            coal.collide(shapes[0], places[0], shapes[1], places[1], request, collision)
            count += collision.isCollision()
        return count

    def poses(self, q: FloatArray) -> list[FloatArray]:
        """Return the places of all links at joint positions, (n, dof): (n, 4, 4) each."""
        chain = self._chain
        poses = [np.broadcast_to(_matrix(chain.base.rotation, chain.base.position), (len(q), 4, 4))]
        for k, axis in enumerate(chain.axes):
            turned = np.zeros((len(q), 4, 4))
            turn = Rotation.from_rotvec(q[:, k, None] * axis).as_matrix()
            turned[:, :3, :3] = chain.rotations[k] @ turn
            turned[:, :3, 3] = chain.positions[k]
            turned[:, 3, 3] = 1.0
            poses.append(poses[-1] @ turned)
        return poses


def _ball(shape: Any) -> tuple[FloatArray, float]:
    """Return the centre and radius of a ball that holds a body of the library."""
    match shape:
        case coal.Sphere():
            radius = shape.radius
        case coal.Capsule():
            radius = shape.radius + shape.halfLength
        case coal.Cylinder():
            radius = np.hypot(shape.radius, shape.halfLength)
        case coal.Box():
            radius = np.linalg.norm(shape.halfSide)
        case _:
            points = shape.vertices()
            centre = (points.min(axis=0) + points.max(axis=0)) / 2
            return centre, np.linalg.norm(points - centre, axis=1).max()
    return np.zeros(3), radius


def _body(x: LinkShape) -> tuple[object, FloatArray]:
    """Return a body of the library, of triangles where it is a mesh, and its place in its link."""
    shape = x.exact or x.shape
    place = x.place
    made: object
    match shape:
        case Mesh():
            triangles = shape.triangles
            if triangles is None:
                triangles = ConvexHull(shape.points).simplices.astype(np.intp)
            made = coal.BVHModelOBBRSS()
            made.beginModel(len(triangles), len(shape.points))
            made.addVertices(np.ascontiguousarray(shape.points))
            made.addTriangles(np.ascontiguousarray(triangles, dtype=np.int64))
            made.endModel()
        case Sphere():
            made = coal.Sphere(shape.radius)
        case Capsule():
            made = coal.Capsule(shape.radius, shape.length)
        case Cylinder():
            made = coal.Cylinder(shape.radius, shape.length)
        case Box():
            made = coal.Box(*shape.size.tolist())
        case _:
            raise TypeError(type(shape))
    return made, _matrix(place.rotation, place.position)


def _matrix(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """Return a frame as a matrix, (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = position
    return matrix


def judge_motion(
    arm: ac.Arm,
    rng: np.random.Generator,
    tally: Tally,
    finer: int = FINER,
) -> None:
    """Check a random motion in a random scene; if it is clear, look at it at random times."""
    motion = random_motion(arm, rng)
    scene = random_scene(rng)
    clearance = ac.check_clearance(motion, arm, scene)
    tally.motions += 1
    if not clearance.satisfied:
        return
    tally.clear += 1
    pairs, _ = pairs_of(arm, scene)
    assert arm.chain is not None
    judge = Judge(arm.chain, pairs)
    times = rng.uniform(0, motion.duration, finer * clearance.evaluations // len(pairs))
    tally.looks += len(times) * len(pairs)
    tally.touches += judge.touches(motion(times))


def mujoco_contacts(arm: ac.Arm) -> Callable[[FloatArray], set[frozenset[str]]]:
    """Return a function that asks MuJoCo which links touch at joint positions."""
    import mujoco

    assert arm.chain is not None and arm.shapes is not None
    chain = arm.chain
    depth = 0
    assets = []
    geoms = {k: "" for k in range(arm.dof + 1)}
    for k, x in enumerate(arm.shapes.shapes):
        assert isinstance(x.shape, Mesh)
        points = x.place.position + x.shape.points @ x.place.rotation.T
        assets.append(f'<mesh name="m{k}" vertex="{_words(points)}"/>')
        geoms[x.link] += f'<geom type="mesh" mesh="m{k}" name="{x.name}"/>'
    text = geoms[0]
    for k in range(arm.dof):
        turn = Rotation.from_matrix(np.array(chain.rotations[k])).as_quat()[[3, 0, 1, 2]]
        text += (
            f'<body pos="{_words(chain.positions[k])}" quat="{_words(turn)}">'
            f'<joint type="hinge" axis="{_words(chain.axes[k])}"/>{geoms[k + 1]}'
        )
        depth += 1
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{''.join(assets)}</asset><worldbody><body>{text}{'</body>' * depth}"
        "</body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)

    def contacts(q: FloatArray) -> set[frozenset[str]]:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        return {
            frozenset(model.geom(i).name for i in contact.geom)
            for contact in data.contact
            if contact.dist <= 0
        }

    return contacts


def _words(values: FloatArray) -> str:
    """Write numbers as the text of an attribute."""
    return " ".join(repr(float(x)) for x in np.ravel(values))


class ContactComparison(NamedTuple):
    """Contacts of body pairs at random postures, by this program and by MuJoCo.

    Args:
        pairs: Number of compared pairs.
        touching: Number of pairs that touch according to MuJoCo.
        different: Number of pairs that touch for one program only.
        worst: Largest distance or depth of these pairs [m].
    """

    pairs: int
    touching: int
    different: int
    worst: float


def compare_contacts(arm: ac.Arm, rng: np.random.Generator, count: int) -> ContactComparison:
    """Compare contacts at random postures."""
    contacts = mujoco_contacts(arm)
    pairs, _ = pairs_of(arm, Scene())
    assert arm.chain is not None
    every = np.arange(len(pairs))
    distances = Distances(arm.chain, pairs)
    limits = arm.limits.for_joints(arm.dof)
    touching = 0
    worst = 0.0
    different = 0
    for q in rng.uniform(limits.joint_lower, limits.joint_upper, (count, arm.dof)):
        theirs = contacts(q)
        ours = distances.measure(q[None], 0 * every, every)
        for pair, distance in zip(pairs, ours.tolist(), strict=True):
            touch = frozenset((pair.first.name, pair.second.name)) in theirs
            touching += touch
            if touch != (distance <= 0):
                different += 1
                worst = max(worst, abs(distance))
    return ContactComparison(count * len(pairs), touching, different, worst)


def run(seed: int) -> Outcome:
    """Judge a random motion of an arm, and compare contacts at random postures with MuJoCo."""
    name = ARMS[seed % len(ARMS)]
    rng = np.random.default_rng(seed)
    tally = Tally()
    arm = ac.load_arm(name)
    judge_motion(arm, rng, tally)
    contacts = compare_contacts(arm, rng, POSTURES)
    notes = [f"{tally.touches} touches of a motion certified clear"] if tally.touches else []
    if contacts.worst > EXCESS:
        distance = f"{contacts.worst * 1e6:.2f} um"
        notes.append(f"MuJoCo differs at {contacts.different} pairs, by up to {distance}")
    return Outcome(kind=name, result="clear" if tally.clear else "not clear", notes=notes)
