"""Which pairs of bodies are looked at, how near they may come, and how fast they can approach."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.robot import Arm, Chain
from armcontour.robot.scene import ArmShapes, HalfSpace, LeftOut, Mesh, Scene, Shape
from armcontour.robot.scene.scene import BASE, TOOL

ENVIRONMENT, OWN = "environment", "own"
# The kind of the pairs of links with the plane in which the base is mounted.
MOUNTING = "mounting"
# The links before this one turn about the base; links that come lower than this below the plane are
# below it [m].
FIRST_RAISED, BELOW = 2, 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """A shape that moves with a link, or stands still.

    Args:
        name: Name of the link or obstacle.
        link: The link that it moves with, 0 for the base; obstacles stand still like the base.
        shape: The shape.
        place: The frame of the shape, in the frame of the link.
        exact: The body itself, where the shape is a larger one.
        tool: Whether it belongs to the tool.
    """

    name: str
    link: int
    shape: Shape
    place: Frame
    exact: Shape | None = None
    tool: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """Two bodies whose distance is looked at.

    Args:
        first, second: The bodies; the second one moves with the later link.
        kind: "environment", "own" or "tool".
        margin: How near they may come to each other [m].
        radii: How fast they can approach each other per joint velocity, at most [m/rad], (dof,).
    """

    first: Body
    second: Body
    kind: str
    margin: float
    radii: FloatArray


def pairs_of(arm: Arm, scene: Scene) -> tuple[tuple[Pair, ...], tuple[LeftOut, ...]]:
    """The pairs of bodies of an arm and its cell that are looked at, and those that are not.

    Args:
        arm: The arm, with a chain and shapes.
        scene: Its cell.

    Raises:
        InvalidInput: The arm has no shapes, or an obstacle allows something unknown to touch it, or
            has the name of a body that moves.
    """
    chain, shapes = _parts(arm)
    own = [
        Body(name=x.name, link=x.link, shape=x.shape, place=x.place, exact=x.exact, tool=x.tool)
        for x in shapes.shapes
    ]
    _refuse_unknown(own, scene)
    radii = {id(x): _radii(chain, x) for x in own}
    pairs: list[Pair] = []
    left = _without_shape(chain, own)
    for obstacle, body, margin, allowed in _with_obstacles(chain, own, scene):
        if body.link == 0:
            reason = "both stand still"
        elif allowed:
            reason = f"{obstacle.name} allows it to touch"
        else:
            kind = TOOL if body.tool else ENVIRONMENT
            pairs.append(_pair(radii, obstacle, body, kind, margin))
            continue
        left.append(LeftOut(first=obstacle.name, second=body.name, reason=reason))
    given = {frozenset((x.first, x.second)): x.reason for x in shapes.left_out}
    for first, second in combinations(sorted(own, key=lambda x: x.link), 2):
        why = _why_left_out(first, second, given)
        if why is None:
            kind = TOOL if second.tool or first.tool else OWN
            margin = scene.margins.tool if kind == TOOL else scene.margins.own
            pairs.append(_pair(radii, first, second, kind, margin))
        elif first.name != second.name:
            left.append(LeftOut(first=first.name, second=second.name, reason=why))
    return tuple(pairs), tuple(dict.fromkeys(left))


def mounting_pairs(arm: Arm, scene: Scene) -> tuple[Pair, ...]:
    """The links that should stay above the plane in which the base is mounted, paired with it.

    Args:
        arm: As in `pairs_of`.
        scene: As in `pairs_of`.

    Raises:
        InvalidInput: As in `pairs_of`.
    """
    if arm.dimension != 3 or not scene.has_mounting_plane:
        return ()
    chain, shapes = _parts(arm)
    plane = Body(name="mounting plane", link=0, shape=HalfSpace(), place=Frame())
    own = (
        Body(name=x.name, link=x.link, shape=x.shape, place=x.place)
        for x in shapes.shapes
        if not x.tool and x.link >= FIRST_RAISED
    )
    return tuple(
        Pair(first=plane, second=x, kind=MOUNTING, margin=-BELOW, radii=_radii(chain, x))
        for x in own
    )


def _parts(arm: Arm) -> tuple[Chain, ArmShapes]:
    """Chain and shapes of an arm.

    Raises:
        InvalidInput: The arm lacks one of them.
    """
    if arm.chain is None:
        raise InvalidInput(f"The arm {arm.name} has no chain of links, so it has no clearance.")
    if arm.shapes is None or not arm.shapes.shapes:
        raise InvalidInput(
            f"The shapes of the links of the arm {arm.name} are not known, so nothing can be said "
            "of its clearance: give a description (URDF) with collision geometry, or "
            "arm.shapes of a job (arm.with_shapes in Python)."
        )
    return arm.chain, arm.shapes


def _without_shape(chain: Chain, own: Iterable[Body]) -> list[LeftOut]:
    """Links of which no shape is known, so that nothing is said of them."""
    known = {x.link for x in own}
    return [
        LeftOut(
            first=f"the link after {joint}",
            second="everything",
            reason="no shape of it is known",
        )
        for k, joint in enumerate(chain.joints, start=1)
        if k not in known
    ]


def _refuse_unknown(own: Iterable[Body], scene: Scene) -> None:
    """Refuse an obstacle that allows what the arm does not have, or that is a link of the arm."""
    own = list(own)
    names, moving = {x.name for x in own} | {TOOL}, {x.name for x in own if x.link}
    end = max((x for x in own if not x.tool), key=lambda x: x.link, default=None)
    repair = "Remove the name" if end is None else f"Write {end.name}, the end of the arm,"
    for x in scene.obstacles:
        if x.name in moving:
            raise InvalidInput(
                f"{x.name} is an obstacle of the scene, and a body of the arm that moves: give its "
                "scene without the arm, or the obstacle another name."
            )
        for name in x.allow:
            if name not in names:
                raise InvalidInput(
                    f"{x.name} of the scene allows {name!r} to touch it, but the bodies of the arm "
                    f"are {', '.join(sorted(names))}. {repair} in allow of {x.name}."
                )


def _with_obstacles(
    chain: Chain, own: Iterable[Body], scene: Scene
) -> Iterable[tuple[Body, Body, float, bool]]:
    """Every obstacle with every body of the arm: their margin, and whether they may touch."""
    own = list(own)
    for x in scene.obstacles:
        # Link 0 is the base, whose frame in the work frame is the chain's base.
        place = x.place if x.fixed_to == BASE else chain.base.inverse @ x.place
        hull, exact = x.shape, None
        if isinstance(hull, Mesh) and hull.triangles is not None:
            hull, exact = hull.hull, hull
        obstacle = Body(name=x.name, link=0, shape=hull, place=place, exact=exact)
        for body in own:
            of_kind = scene.margins.tool if body.tool else scene.margins.environment
            margin = of_kind if x.margin is None else x.margin
            yield obstacle, body, margin, body.name in x.allow or (body.tool and TOOL in x.allow)


def _why_left_out(first: Body, second: Body, given: dict[frozenset[str], str]) -> str | None:
    """Why the distance of two bodies of the arm is not looked at; None if it is."""
    if first.link == second.link:
        return "they move together"
    reason = given.get(frozenset((first.name, second.name)))
    if reason is not None:
        return reason
    # A tool may be bent back to the link before the last one, as far as the joint between lets it.
    return "neighbours" if second.link == first.link + 1 and not second.tool else None


def _pair(
    radii: Mapping[int, FloatArray], first: Body, second: Body, kind: str, margin: float
) -> Pair:
    """A pair, with how fast its bodies can approach each other.

    Args:
        radii: What `_radii` gives, by the identities of the bodies.
        first: The body of the earlier link.
        second: The other body.
        kind: The kind.
        margin: The margin [m].
    """
    # Only joints between both links move the bodies against each other.
    between = np.arange(len(radii[id(second)])) >= first.link
    return Pair(
        first=first, second=second, kind=kind, margin=margin, radii=radii[id(second)] * between
    )


def _radii(chain: Chain, body: Body) -> FloatArray:
    """Largest distances of points of a body from the axes of joints, in any posture [m], (dof,).

    Args:
        chain: The chain.
        body: The body; joints after its link do not move it.
    """
    found = np.zeros(len(chain))
    middle, radius = body.shape.ball
    middle = body.place.position + body.place.rotation @ middle
    for k in range(body.link - 1, -1, -1):
        # A ball about a point of the axis holds the body however the joint turns.
        along = chain.axes[k] * float(chain.axes[k] @ middle)
        found[k] = radius = radius + float(np.linalg.norm(middle - along))
        middle = chain.positions[k] + chain.rotations[k] @ along
    return found
