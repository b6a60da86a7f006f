"""Jobs that an arm can do, made impossible by one narrow range or one held axis, by seed."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import armcontour as ac
from armcontour.core.frames import exp
from armcontour.planning.tracing import trace_all
from armcontour.robot import JointPreference, SerialArm

KINDS = ("rail", "positioner", "gantry", "cell", "orientation", "axis")
# Joints of a six-joint arm of 1.5 m: name, origin, axis, range, velocity.
JOINTS = (
    ("joint_1", (0, 0, 0), (0, 0, 1), -3.14, 3.14, 2.6),
    ("joint_2", (0.1, 0, 0.615), (0, 1, 0), -1.75, 1.92, 2.6),
    ("joint_3", (0, 0, 0.705), (0, 1, 0), -1.05, 1.13, 2.6),
    ("joint_4", (0.258, 0, 0.135), (1, 0, 0), -3.49, 3.49, 6.3),
    ("joint_5", (0.497, 0, 0), (0, 1, 0), -2.09, 2.09, 6.3),
    ("joint_6", (0.085, 0, 0), (1, 0, 0), -6.98, 6.98, 7.8),
)
TOOL = ac.Frame(position=(0, 0, 0.3))
# Attempts to make a job impossible.
ATTEMPTS = 8


def _joint(name, kind, parent, child, origin, axis=None, lower=0.0, upper=0.0, velocity=1.0):
    """Return a joint of a URDF."""
    text = f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    text += f'<origin xyz="{" ".join(map(str, origin))}"/>'
    if axis is not None:
        text += f'<axis xyz="{" ".join(map(str, axis))}"/>'
        text += f'<limit effort="0" lower="{lower}" upper="{upper}" velocity="{velocity}"/>'
    return text + "</joint>"


def _arm_text(base):
    """Return links and joints of the six-joint arm on a link, with the flange tool0."""
    text = ""
    parent = base
    for k, (name, origin, axis, lower, upper, velocity) in enumerate(JOINTS):
        text += _joint(name, "revolute", parent, f"a{k}", origin, axis, lower, upper, velocity)
        text += f'<link name="a{k}"/>'
        parent = f"a{k}"
    return (
        text + '<link name="tool0"/><joint name="flange" type="fixed"><parent link="a5"/>'
        '<child link="tool0"/><origin rpy="0 1.5707963267948966 0"/></joint>'
    )


@cache
def urdf_arm(kind):
    """Return the arm of a URDF: alone, under a gantry, or in a cell with a positioner."""
    text = '<link name="world"/>'
    options = {"tip": "tool0"}
    if kind == "gantry":
        parent = "world"
        for name, axis, upper in (
            ("gx", (1, 0, 0), 4),
            ("gy", (0, 1, 0), 2),
            ("gz", (0, 0, -1), 1),
        ):
            text += _joint(name, "prismatic", parent, name, (0, 0, 0), axis, 0, upper, 0.8)
            text += f'<link name="{name}"/>'
            parent = name
        # The arm hangs below.
        text += f'<link name="base"/><joint name="hang" type="fixed"><parent link="{parent}"/>'
        text += '<child link="base"/><origin xyz="0 0 2.6" rpy="3.141592653589793 0 0"/></joint>'
        text += _arm_text("base")
    else:
        text += _arm_text("world")
    if kind == "cell":
        text += _joint("tilt", "revolute", "world", "tilted", (1.15, 0, 0.6), (0, 1, 0), -3, 3, 1.6)
        text += '<link name="tilted"/><link name="table"/>'
        text += _joint("turn", "revolute", "tilted", "table", (0, 0, 0.15), (0, 0, 1), -6.9, 6.9, 2)
        options["part"] = "table"
    file = Path(mkdtemp()) / f"{kind}.urdf"
    file.write_text(f'<robot name="{kind}">{text}</robot>')
    return ac.load_arm(str(file), **options, tool=TOOL)


def make_arm(kind, seed, tilt=None):
    """Return the arm of a job, with another tilt [rad] of its positioner if one is given."""
    if kind in ("gantry", "cell"):
        return urdf_arm(kind)
    if kind in ("orientation", "axis") and seed % 2:
        return urdf_arm("alone")
    arm = ac.load_arm("ur10e").with_tool(TOOL)
    if kind == "rail":
        return arm.with_rail(
            ac.Rail(axis=(0, 1, 0), lower=-1.5, upper=1.5, velocity=0.8, acceleration=1.5)
        )
    if kind == "positioner":
        axes = []
        for name, axis, z, end in (("tilt", (0, 1, 0), 0.3, 1.8), ("turn", (0, 0, 1), 0.4, 7.0)):
            axes.append(
                ac.PositionerAxis(name=name, axis=axis, origin=(0.9, 0, z), lower=-end, upper=end,
                                  velocity=1.0, acceleration=1.8)
            )  # fmt: skip
        if tilt is None and seed % 4:
            tilt = np.radians((10, 20, 40)[seed % 3])
        return arm.with_positioner(ac.Positioner(axes=tuple(axes), tilt=tilt))
    return arm


def make_path(kind, rng):
    """Return a tool path for a kind of job."""
    if kind in ("positioner", "cell"):
        center = np.array([0.9, 0, 0.4] if kind == "positioner" else [1.15, 0, 0.75])
        ring = np.linspace(0, rng.uniform(0.3, 1.0) * 2 * np.pi, 25) + rng.uniform(-3, 3)
        around = np.column_stack([np.cos(ring), np.sin(ring), np.zeros(len(ring))])
        points = center + rng.uniform(0.04, 0.1) * around + [0, 0, rng.uniform(0.05, 0.2)]
        axes = -around * np.tan(rng.uniform(0.2, 0.9)) - [0, 0, 1]
        return ac.Path.polyline(points).pointing(axes)
    count = int(rng.integers(2, 5))
    sizes = {"rail": (0.15, 0.5, 0.1), "gantry": (0.4, 0.3, 0.1)}.get(kind, (0.12, 0.2, 0.1))
    steps = rng.normal(size=(count, 3)) * sizes
    first = {
        "rail": (rng.uniform(0.6, 0.9), rng.uniform(-0.8, 0.8), rng.uniform(0.1, 0.4)),
        "gantry": (rng.uniform(1.0, 3.5), rng.uniform(-1.5, 0.5), rng.uniform(0.4, 0.8)),
    }.get(kind, (rng.uniform(0.55, 0.9), rng.uniform(-0.3, 0.3), rng.uniform(0.1, 0.6)))
    points = np.array(first) + np.cumsum(np.vstack([np.zeros(3), steps]), axis=0)
    axes = np.array([0, 0, -1.0]) + rng.normal(size=(count + 1, 3)) * 0.15
    path = ac.Path.polyline(points)
    if kind != "orientation":
        return path.pointing(axes)
    rotations = []
    turn = rng.uniform(-np.pi, np.pi)
    for axis in axes:
        z = axis / np.linalg.norm(axis)
        x = np.cross([np.sin(turn), np.cos(turn), 0.2], z)
        x /= np.linalg.norm(x)
        rotations.append(np.column_stack([x, np.cross(z, x), z]))
    return path.oriented(np.array(rotations))


def reason(path, arm):
    """Return the refusal of a path, or None if it is traced."""
    try:
        trace_all(path, arm, max_count=1)
    except ac.Unreachable as error:
        return error
    return None


@dataclass
class Refused:
    """A job with one narrow range or one held axis."""

    kind: str
    seed: int
    path: ac.Path
    arm: SerialArm  # With the narrow range or the held axis
    joint: int
    name: str
    change: str
    apply: Callable[[SerialArm], SerialArm]  # Applies the change to another arm
    error: ac.Unreachable

    @property
    def is_named(self) -> bool:
        """True if the refusal is about the changed joint."""
        return self.error.joint == self.joint

    def remedies(self):
        """Return the remedies of the message, each with an arm to which it is applied."""
        text = str(self.error)
        arms = {}
        for told in re.findall(r"[Dd]o not hold .*?(?=, or)", text):
            arms[told] = make_arm(self.kind, self.seed)
        for told, number, ends in re.findall(
            r"([Ll]et joint (\d+) \(.*?\) move to (.*?)), or", text
        ):
            joint = int(number) - 1
            values = []
            for value, unit in re.findall(r"(-?[\d.e-]+) (deg|mm)", ends):
                values.append(float(value) * (np.pi / 180 if unit == "deg" else 1e-3))
            lower, upper = (x[joint] for x in self.arm.limits.joint_range(self.arm.dof))
            own = make_arm(self.kind, self.seed) if joint == self.joint else self.arm
            arms[told] = narrow(own, joint, min(lower, *values), max(upper, *values))
        for told, angle in re.findall(r"([Ss]pecify a tilt of at least ([\d.]+) deg)", text):
            arms[told] = self.apply(make_arm(self.kind, self.seed, np.radians(float(angle))))
        return arms

    def wrong_remedies(self):
        """Return the remedies of the message with which the path is still refused."""
        return [told for told, arm in self.remedies().items() if reason(self.path, arm)]


def narrow(arm, joint, lower, upper):
    """Return the arm with another range of one joint."""
    low, high = (x.copy() for x in arm.limits.joint_range(arm.dof))
    low[joint] = lower
    high[joint] = upper
    return arm.with_limits(arm.limits.replace(joint_lower=low, joint_upper=high))


def prefer(arm, name, preference):
    """Return the arm with a preference for one joint."""
    return arm.with_preferences({name: preference})


def refused_job(kind, seed):
    """Return a job that is refused for a known reason, or None if the seed makes none."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    path = make_path(kind, rng)
    arm = make_arm(kind, seed)
    try:
        traced = trace_all(path, arm, max_count=1)[0]
    except ac.ArmContourError:
        return None
    q = traced(np.linspace(0, traced.length, 60))
    external = {"rail": ["rail"], "positioner": ["tilt", "turn"], "gantry": ["gx", "gy", "gz"],
                "cell": ["tilt", "turn"]}.get(kind, [])  # fmt: skip
    for _ in range(ATTEMPTS):
        names = external if external and rng.random() < 0.7 else arm.joint_names
        name = names[rng.integers(len(names))]
        joint = arm.joint_names.index(name)
        low, high = (x[joint] for x in arm.limits.joint_range(arm.dof))
        low = max(low, -2 * np.pi)
        high = min(high, 2 * np.pi)
        if name in external and rng.random() < 0.5:
            position = float(rng.uniform(low, high))
            apply = partial(prefer, name=name, preference=JointPreference(hold=position))
            change = f"hold {position:.3f}"
        else:
            least = q[:, joint].min()
            most = q[:, joint].max()
            if rng.random() < 0.5:
                share = rng.uniform(-0.3, 0.8)
                cut = least + share * (most - least) - 0.05
                ends = (low, cut) if rng.random() < 0.5 else (least + most - cut, high)
            else:
                center = rng.uniform(low, high)
                half = rng.uniform(0.02, 0.3) * (high - low) / 2
                ends = (max(center - half, low), min(center + half, high))
            if not ends[0] + 0.01 < ends[1]:
                continue
            ends = tuple(map(float, ends))
            change = f"range {ends[0]:.3f} to {ends[1]:.3f}"
            if rng.random() < 0.5:
                apply = partial(narrow, joint=joint, lower=ends[0], upper=ends[1])
            else:
                apply = partial(prefer, name=name, preference=JointPreference(range=ends))
                change = f"preferred {change}"
        changed = apply(arm)
        error = reason(path, changed)
        if error is not None:
            return Refused(kind, seed, path, changed, joint, name, change, apply, error)
    return None


def singular_job(seed):
    """Return a path through a wrist singularity, and an arm without another way; None if there is.

    The tool moves and turns in the direction that it loses where axes 4 and 6 are in line.
    """
    rng = np.random.default_rng([99, seed])
    arm = make_arm("orientation", seed)
    q = rng.uniform([-1.0, -0.6, -0.5, -1.5, 0, -1.5], [1.0, 0.6, 0.6, 1.5, 0, 1.5])
    if seed % 2 == 0:
        # This arm has its elbow and its wrist elsewhere.
        q = q * 0.5 + [0, -1.2, 1.4, -0.4, 0, 0]
        arm = arm.with_limits(
            arm.limits.replace(joint_lower=q - [1.2, 1.0, 1.0, 3.0, 3.0, 3.0],
                               joint_upper=q + [1.2, 1.0, 1.0, 3.0, 3.0, 3.0])
        )  # fmt: skip
    pose = arm.forward(q)
    lost = np.linalg.svd(arm.jacobian(q))[0][:, -1]
    ends = rng.uniform(0.03, 0.08) * np.array([[-1.0], [1.0]])
    path = ac.Path.polyline(pose[:3, 3] + ends * lost[:3])
    path = path.oriented(exp(ends * lost[3:]) @ pose[:3, :3])
    error = reason(path, arm)
    return None if error is None else (path, arm, error)
