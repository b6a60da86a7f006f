"""Pairs of bodies for clearance checks, with margins and bounds on the approach speed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import combinations

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.robot import Arm, Chain
from armcontour.robot.scene import (
    BASE,
    PART,
    TOOL,
    ArmShapes,
    HalfSpace,
    LeftOut,
    LinkShape,
    Scene,
)

ENVIRONMENT, OWN = "environment", "own"
# Kind of the pairs of links with the mounting plane of the base.
MOUNTING = "mounting"
# Index of the first link whose height can change, and depth [m] from which a link counts as below
# the mounting plane.
FIRST_RAISED, BELOW = 2, 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """Two bodies whose distance is checked."""

    # first, second: the bodies. The second one moves with the later link.
    first: LinkShape
    second: LinkShape
    kind: str  # "environment", "own" or "tool"
    margin: float  # Smallest allowed distance [m]
    # Bounds on the approach speed per joint speed with prismatic joints at 0 [m/rad], (dof,); 1 for
    # a prismatic joint
    radii: FloatArray

    def radii_at(self, farthest: FloatArray, slides: BoolArray) -> FloatArray:
        """`radii` while prismatic joints (`slides`) are at most `farthest` from 0 [m], (dof,)."""
        # The joints between a revolute joint and the second body move the body away from its axis.
        moved = farthest * slides * (np.arange(len(slides)) < self.second.link)
        later = np.cumsum(moved[::-1])[::-1] - moved
        return self.radii + later * (self.radii > 0) * ~slides


def pairs_of(arm: Arm, scene: Scene) -> tuple[tuple[Pair, ...], tuple[LeftOut, ...]]:
    """Pairs of bodies of an arm and its cell: the pairs to check, and the excluded pairs."""
    chain, shapes = _parts(arm)
    bodies = shapes.shapes
    _check_obstacles(bodies, scene)
    pairs: list[Pair] = []
    radii_of = cache(partial(_radii, chain))
    left_out = _links_without_shape(chain, bodies)
    for first, second, kind, margin, allowed in _obstacle_pairs(chain, bodies, scene):
        if first.link == second.link:
            reason = "both are fixed"
        elif allowed:
            reason = f"{first.name} allows it to touch"
        else:
            pairs.append(_make_pair(radii_of, first, second, kind, margin))
            continue
        left_out.append(LeftOut(first=first.name, second=second.name, reason=reason))
    reasons = {frozenset((x.first, x.second)): x.reason for x in shapes.left_out}
    for first, second in combinations(sorted(bodies, key=lambda x: x.link), 2):
        why = _exclusion_reason(first, second, reasons)
        if why is None:
            kind = TOOL if second.tool or first.tool else OWN
            margin = scene.margins.tool if kind == TOOL else scene.margins.own
            pairs.append(_make_pair(radii_of, first, second, kind, margin))
        elif first.name != second.name:
            left_out.append(LeftOut(first=first.name, second=second.name, reason=why))
    return tuple(pairs), tuple(dict.fromkeys(left_out))


def mounting_pairs(arm: Arm, scene: Scene) -> tuple[Pair, ...]:
    """Links that should stay above the mounting plane of the base, each paired with the plane."""
    if arm.dimension != 3 or not scene.has_mounting_plane:
        return ()
    chain, shapes = _parts(arm)
    floor = chain.floor_link
    plane = LinkShape(
        name="mounting plane", link=floor, shape=HalfSpace(), place=chain.floor, on_floor=True
    )
    # The base of an arm on a rail is also a link.
    raised = floor + FIRST_RAISED + int(chain.slides[floor])
    return tuple(
        _make_pair(partial(_radii, chain), plane, x, MOUNTING, -BELOW)
        for x in shapes.shapes
        if not x.tool and x.link >= raised
    )


def _parts(arm: Arm) -> tuple[Chain, ArmShapes]:
    """Chain and shapes of an arm; raises an error if one of them is unknown."""
    if arm.shapes is None or not arm.shapes.shapes:
        raise InvalidInput(
            f"The shapes of the links of the arm {arm.name} are not known, so its clearance "
            "cannot be computed. Specify a URDF with collision geometry, or arm.shapes in the job "
            "(arm.with_shapes in Python)."
        )
    return arm.chain, arm.shapes


def _links_without_shape(chain: Chain, bodies: Sequence[LinkShape]) -> list[LeftOut]:
    """Exclusions of the links whose shape is unknown."""
    links = {x.link for x in bodies}
    return [
        LeftOut(
            first=f"the link after {joint}",
            second="everything",
            reason="no shape of it is known",
        )
        for k, joint in enumerate(chain.joints, start=1)
        if k > chain.floor_link and k not in links
    ]


def _check_obstacles(bodies: Sequence[LinkShape], scene: Scene) -> None:
    """Check that obstacles are no moving links, and that `allow` names known bodies only."""
    names, moving = {x.name for x in bodies} | {TOOL}, {x.name for x in bodies if x.link}
    if any(x.fixed_to == PART for x in scene.obstacles):
        names |= {x.name for x in scene.obstacles}
    end = max((x for x in bodies if not x.tool), key=lambda x: x.link, default=None)
    repair = "Remove the name" if end is None else f"Write {end.name}, the end of the arm,"
    for obstacle in scene.obstacles:
        if obstacle.name in moving:
            raise InvalidInput(
                f"{obstacle.name} is an obstacle of the scene, but also a moving body of the arm. "
                "Remove the arm from the scene, or rename the obstacle."
            )
        for name in obstacle.allow:
            if name not in names:
                raise InvalidInput(
                    f"{obstacle.name} of the scene allows {name!r} to touch it, but the bodies of "
                    "the arm "
                    f"are {', '.join(sorted(names))}. {repair} in allow of {obstacle.name}."
                )


def _obstacle_pairs(
    chain: Chain, bodies: Sequence[LinkShape], scene: Scene
) -> Iterable[tuple[LinkShape, LinkShape, str, float, bool]]:
    """Yield all pairs with an obstacle, with kind and margin, and True if they may touch."""
    # `chain.base` is the frame of the base or table (link 0) in the work frame.
    floor, part = (chain.floor_link, chain.floor), (0, chain.base.inverse)
    placed = []
    for x in scene.obstacles:
        on_floor = x.fixed_to == BASE
        link, frame = floor if on_floor else part
        place = frame @ x.place
        body = LinkShape(name=x.name, link=link, shape=x.shape, place=place, on_floor=on_floor)
        placed.append((x, body.with_hull()))
    margins = scene.margins
    for x, obstacle in placed:
        for body in bodies:
            kind, usual = (TOOL, margins.tool) if body.tool else (ENVIRONMENT, margins.environment)
            allowed = body.name in x.allow or (body.tool and TOOL in x.allow)
            yield obstacle, body, kind, usual if x.margin is None else x.margin, allowed
    # A positioner moves the part towards obstacles.
    for (x, first), (y, second) in combinations(placed, 2):
        if first.link != second.link:
            own = [z.margin for z in (x, y) if z.margin is not None]
            allowed = y.name in x.allow or x.name in y.allow
            yield first, second, ENVIRONMENT, max(own, default=margins.environment), allowed


def _exclusion_reason(
    first: LinkShape, second: LinkShape, reasons: dict[frozenset[str], str]
) -> str | None:
    """Reason to exclude two bodies of the arm; None if their distance must be checked."""
    if first.link == second.link:
        return "they move together"
    reason = reasons.get(frozenset((first.name, second.name)))
    if reason is not None:
        return reason
    # A bent tool can reach the link before the last one, so tools are never neighbours.
    return "neighbours" if second.link == first.link + 1 and not second.tool else None


def _make_pair(
    radii_of: Callable[[LinkShape], FloatArray],
    one: LinkShape,
    other: LinkShape,
    kind: str,
    margin: float,
) -> Pair:
    """Make a pair with the bounds on its approach speed."""
    first, second = sorted((one, other), key=lambda x: x.link)
    # Only joints between the links of both bodies cause relative motion. The points of a half-space
    # are at any distance from their axes.
    moving = first if isinstance(second.shape, HalfSpace) else second
    radii = radii_of(moving).copy()
    radii[: first.link] = radii[second.link :] = 0.0
    return Pair(first=first, second=second, kind=kind, margin=margin, radii=radii)


def _radii(chain: Chain, body: LinkShape) -> FloatArray:
    """`Pair.radii` of a body: largest distances of its points from the joint axes [m], (dof,)."""
    radii, slides = np.zeros(len(chain)), chain.slides
    middle, size = body.shape.ball
    start = middle = body.place.position + body.place.rotation @ middle
    radius = size
    for k in range(body.link - 1, -1, -1):
        # A ball about a point on the axis contains the body at any joint position.
        if slides[k]:
            radii[k] = 1.0
            middle = chain.positions[k] + chain.rotations[k] @ middle
            continue
        along = chain.axes[k] * float(chain.axes[k] @ middle)
        radii[k] = radius = radius + float(np.linalg.norm(middle - along))
        middle = chain.positions[k] + chain.rotations[k] @ along
    middle, radius = start, size
    for k in range(body.link, chain.floor_link):
        middle = chain.rotations[k].T @ (middle - chain.positions[k])
        along = chain.axes[k] * float(chain.axes[k] @ middle)
        radii[k] = radius = radius + float(np.linalg.norm(middle - along))
        middle = along
    return radii
