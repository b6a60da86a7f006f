"""Choice of the tip of an arm in a robot description if the options do not name it."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from armcontour.core.errors import InvalidInput
from armcontour.core.text import list_some
from armcontour.files.robots.tree import MAX_NAMED, REVOLUTE_TYPES, Joint, Tree

# Suffixes of the names of frames to which tools are attached (REP 199), the preferred first.
TOOL_FRAMES = ("tool0", "flange")
# Next moving joints by the name of the previous moving joint; None for the base.
NextJoints = dict[str | None, list[Joint]]


def choose_tip(tree: Tree, base: str, locked: Collection[str]) -> tuple[str, str]:
    """Tip link of the only chain of moving joints, and a note if other links were possible."""
    # Joints of a gripper are ignored. These are: branches at the end of the chain that have equal
    # lengths and are shorter than the chain; and the last joint of the chain if another joint
    # mimics it.
    parents = {joint.parent for joint in tree.joints.values()}
    ends = [x.child for x in tree.below(base) if x.child not in parents]
    if not ends:
        raise InvalidInput(
            f"No link of {tree.file} is below the base {base}, so no link can be the tip. Choose "
            "another base with base= (in a job, arm: {base: LINK})."
        )
    if len(ends) == 1:
        return ends[0], ""
    chain = _only_chain(tree, _next_moving_joints(tree, base, locked))
    if not chain:
        ends.sort(key=lambda link: -_turning_joints(tree, base, link))
        raise InvalidInput(
            f"{tree.file} has {len(ends)} links that could be the tip. Choose one of "
            f"{list_some(ends, MAX_NAMED)} with tip= (in a job, arm: {{tip: {ends[0]}}}; for "
            f"armcontour check, --tip {ends[0]})."
        )
    tip = _tip_of(tree, chain[-1].child)
    return tip, (
        f"the tip is {tip}, at the end of the only chain of moving joints; to change it, specify "
        f"tip= (in a job, arm: {{tip: LINK}})"
    )


def _next_moving_joints(tree: Tree, base: str, locked: Collection[str]) -> NextJoints:
    """Independent moving joints, by the previous independent joint (None for the base)."""
    following: NextJoints = {None: []}
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


def _only_chain(tree: Tree, following: NextJoints) -> list[Joint]:
    """The only chain of moving joints, without a gripper; empty if there are several chains."""
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


def _without_fingers(following: NextJoints, branches: Sequence[Joint], depth: int) -> list[Joint]:
    """Branches that are not fingers. Fingers have equal lengths, of fewer than `depth` joints."""
    lengths = [_length(following, x) for x in branches]
    fingers = [length < depth and lengths.count(length) > 1 for length in lengths]
    return [x for x, finger in zip(branches, fingers, strict=True) if not finger]


def _length(following: NextJoints, joint: Joint) -> int:
    """Largest number of joints on a branch, from its first joint to an end."""
    waiting, deepest = [(joint, 1)], 1
    while waiting:
        nearest, depth = waiting.pop()
        deepest = max(deepest, depth)
        waiting += [(x, depth + 1) for x in following[nearest.name]]
    return deepest


def _tip_of(tree: Tree, last: str) -> str:
    """Tip among `last` and the links fixed to it: tool frame, else the only end, else `last`."""
    fixed = [last]
    # The loop extends the list that it iterates over.
    for link in fixed:
        fixed += [x.child for x in tree.child_joints(link) if x.kind == "fixed"]
    for name in TOOL_FRAMES:
        named = [link for link in fixed if link.endswith(name)]
        if len(named) == 1:
            return named[0]
    ends = [link for link in fixed if not tree.child_joints(link)]
    return ends[0] if len(ends) == 1 else last


def _turning_joints(tree: Tree, base: str, link: str) -> int:
    """Number of independent revolute joints between the base and a link below it."""
    count = 0
    while link != base:
        joint = tree.parent_joints[link]
        count += joint.kind in REVOLUTE_TYPES and joint.master is None
        link = joint.parent
    return count
