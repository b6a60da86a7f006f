"""Choice of the tip of an arm that a description does not name."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from armcontour.core.errors import InvalidInput
from armcontour.core.text import list_some
from armcontour.files.robots.tree import MAX_NAMED, TURNING, Joint, Tree

# Ends of the names of the frames of REP 199 that tools hang on, the preferred one first.
TOOL_FRAMES = ("tool0", "flange")
# The next moving joints, by the name of a joint, or None for the base.
Next = dict[str | None, list[Joint]]


def choose_tip(tree: Tree, base: str, locked: Collection[str]) -> tuple[str, str]:
    """The only end of an arm or of its only chain of moving joints, and a note of the choice."""
    # The joints of a gripper are ignored: branches at the end of a chain that are equally long and
    # shorter than the chain, and a last joint that another joint mimics.
    parents = {joint.parent for joint in tree.joints.values()}
    ends = [x.child for x in tree.below(base) if x.child not in parents]
    if len(ends) == 1:
        return ends[0], ""
    chain = _only_chain(tree, _next_joints(tree, base, locked))
    if not chain:
        ends.sort(key=lambda link: -_turning_joints(tree, base, link))
        example = ends[0] if ends else "LINK"
        raise InvalidInput(
            f"{tree.file} has {len(ends) or 'no'} links that could be the tip: choose one with "
            f"tip= (in a job, arm: {{tip: {example}}}; for check, --tip {example}), one of "
            f"{list_some(ends or list(tree.links), MAX_NAMED)}."
        )
    tip = _end_of(tree, chain[-1].child)
    return tip, (
        f"the tip is {tip}, at the end of the only chain of moving joints: name another link "
        f"with tip= (in a job, arm: {{tip: LINK}})"
    )


def _next_joints(tree: Tree, base: str, locked: Collection[str]) -> Next:
    """The independently moving joints, by the independent joint that carries them."""
    following: Next = {None: []}
    carrier: dict[str, str] = {}
    for joint in tree.below(base):
        above = carrier.get(joint.parent)
        if joint.kind != "fixed" and joint.master is None and joint.name not in locked:
            following[above].append(joint)
            following[joint.name] = []
            above = joint.name
        if above is not None:
            carrier[joint.child] = above
    return following


def _only_chain(tree: Tree, following: Next) -> list[Joint]:
    """The only chain of moving joints, without a gripper's; empty if there are more."""
    mimicked = {joint.master for joint in tree.joints.values()}
    chain: list[Joint] = []
    carrier: str | None = None
    while following[carrier]:
        branches = _without_fingers(following, following[carrier], len(chain))
        if len(branches) > 1:
            return []
        if not branches:
            break
        carrier = branches[0].name
        chain.append(branches[0])
    if len(chain) > 1 and chain[-1].name in mimicked:
        chain.pop()
    return chain


def _without_fingers(following: Next, branches: Sequence[Joint], depth: int) -> list[Joint]:
    """The branches at a fork without fingers: equally long, and shorter than the chain before."""
    lengths = [_length(following, x) for x in branches]
    fingers = [length < depth and lengths.count(length) > 1 for length in lengths]
    return [x for x, finger in zip(branches, fingers, strict=True) if not finger]


def _length(following: Next, joint: Joint) -> int:
    """The number of joints of a branch, from its first joint to its farthest."""
    waiting, deepest = [(joint, 1)], 1
    while waiting:
        nearest, depth = waiting.pop()
        deepest = max(deepest, depth)
        waiting += [(x, depth + 1) for x in following[nearest.name]]
    return deepest


def _end_of(tree: Tree, last: str) -> str:
    """The end of an arm, among the links that are fixed to its last link."""
    fixed = [last]
    # The list grows while it is read.
    for link in fixed:
        fixed += [x.child for x in tree.from_link(link) if x.kind == "fixed"]
    for name in TOOL_FRAMES:
        named = [link for link in fixed if link.endswith(name)]
        if len(named) == 1:
            return named[0]
    ends = [link for link in fixed if not tree.from_link(link)]
    return ends[0] if len(ends) == 1 else last


def _turning_joints(tree: Tree, base: str, link: str) -> int:
    """The number of turning joints between the base and a link below it."""
    count = 0
    while link != base:
        joint = tree.above[link]
        count += joint.kind in TURNING and joint.master is None
        link = joint.parent
    return count
