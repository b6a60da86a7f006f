"""Kinematics of whole cells by products of exponentials, which shares no code with the package.

It reads the job file and its robot description with its own parser. Poses are homogeneous
transforms with shape (n, 4, 4); joint positions have shape (n, joints).
"""

import csv
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

# Denavit-Hartenberg parameters a [m], alpha [rad], d [m] that Universal Robots publishes.
UR10E = [
    (0.0, np.pi / 2, 0.1807),
    (-0.6127, 0.0, 0.0),
    (-0.57155, 0.0, 0.0),
    (0.0, np.pi / 2, 0.17415),
    (0.0, -np.pi / 2, 0.11985),
    (0.0, 0.0, 0.11655),
]
UR_JOINTS = "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 wrist_3".split()
UNITS = {"mm": 1e-3, "m": 1.0, "deg": np.pi / 180, "rad": 1.0, "s": 1.0}


@dataclass(frozen=True)
class Joint:
    """A joint: a fixed transform, then a rotation about or a translation along an axis."""

    name: str  # empty for a fixed transform
    kind: str  # "revolute", "prismatic" or "fixed"
    before: np.ndarray  # transform from the previous joint, shape (4, 4)
    axis: np.ndarray  # unit vector, shape (3,)
    factor: float = 1.0  # of the position of the named joint, for joints that mimic another one
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf


def number(value):
    """Return a number in SI units from a plain number or text such as `90 deg/s`."""
    if not isinstance(value, str):
        return float(value)
    amount, _, unit = value.strip().partition(" ")
    found = float(amount)
    above, _, below = unit.partition("/")
    found *= UNITS.get(above, 1.0)
    return found


def numbers(values):
    """Return an array from a list of numbers or text with units."""
    return np.array([number(x) for x in values])


def about(axis, angle):
    """Rotation about an axis by angles, shape (n, 3, 3), by Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.atleast_1d(angle)[:, None, None]
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def transform(position=(0, 0, 0), rotation=None):
    """One transform, shape (4, 4)."""
    found = np.eye(4)
    found[:3, 3] = position
    if rotation is not None:
        found[:3, :3] = rotation
    return found


def from_rpy(roll, pitch, yaw):
    """Rotation matrix of fixed-axis roll, pitch and yaw, shape (3, 3)."""
    return (about((0, 0, 1), yaw) @ about((0, 1, 0), pitch) @ about((1, 0, 0), roll))[0]


def inverse(poses):
    """Inverse of transforms."""
    found = np.array(poses)
    turned = np.swapaxes(poses[:, :3, :3], 1, 2)
    found[:, :3, :3] = turned
    found[:, :3, 3] = -(turned @ poses[:, :3, 3, None])[..., 0]
    return found


def of_frame(keys):
    """Transform of a mapping with `position` and `rpy`, as job files have it."""
    keys = keys or {}
    rotation = from_rpy(*numbers(keys.get("rpy", (0, 0, 0))))
    return transform(numbers(keys.get("position", (0, 0, 0))), rotation)


class Description:
    """The links and joints of a URDF."""

    def __init__(self, file):
        self.joint_above = {}
        self.parent = {}
        for element in ElementTree.parse(file).getroot().findall("joint"):
            child = element.find("child").get("link")
            self.parent[child] = element.find("parent").get("link")
            self.joint_above[child] = joint_of(element)

    def chain(self, base, tip):
        """Joints from the link `base` to the link `tip`."""
        joints = []
        while tip != base:
            joints.insert(0, self.joint_above[tip])
            tip = self.parent[tip]
        return joints

    def root(self):
        """Name of the link without a parent."""
        (found,) = set(self.parent.values()) - set(self.parent)
        return found


def joint_of(element):
    """Joint of an element of a URDF."""
    words = {"xyz": "0 0 0", "rpy": "0 0 0"}
    if element.find("origin") is not None:
        words |= element.find("origin").attrib
    before = transform(
        [float(x) for x in words["xyz"].split()],
        from_rpy(*(float(x) for x in words["rpy"].split())),
    )
    kind = element.get("type")
    if kind == "fixed":
        return Joint(name="", kind="fixed", before=before, axis=np.zeros(3))
    axis = np.array([float(x) for x in element.find("axis").get("xyz").split()])
    mimic = element.find("mimic")
    limit = element.find("limit")
    edges = {}
    if limit is not None:
        edges["velocity"] = float(limit.get("velocity"))
        if kind != "continuous":
            edges["lower"] = float(limit.get("lower"))
            edges["upper"] = float(limit.get("upper"))
    return Joint(
        name=element.get("name") if mimic is None else mimic.get("joint"),
        kind="prismatic" if kind == "prismatic" else "revolute",
        before=before,
        axis=axis / np.linalg.norm(axis),
        factor=1.0 if mimic is None else float(mimic.get("multiplier")),
        **edges,
    )


def ur10e_joints():
    """The six joints of a UR10e, each with the transform that follows the joint before it."""
    before = np.eye(4)
    joints = []
    for name, (a, alpha, d) in zip(UR_JOINTS, UR10E, strict=True):
        joints.append(
            Joint(
                name=f"{name}_joint",
                kind="revolute",
                before=before,
                axis=np.array([0.0, 0.0, 1.0]),
                lower=-2 * np.pi,
                upper=2 * np.pi,
                velocity=np.pi * (2 / 3 if name.startswith("shoulder") else 1),
            )
        )
        before = transform((0, 0, d)) @ transform((a, 0, 0), about((1, 0, 0), alpha)[0])
    return [*joints, Joint(name="", kind="fixed", before=before, axis=np.zeros(3))]


def of_keys(name, keys):
    """Joint of a rail or of a positioner's axis; the next frame is again that of the base."""
    origin = numbers(keys.get("origin", (0, 0, 0)))
    axis = numbers(keys["axis"])
    slides = name == "rail" or keys.get("kind") == "prismatic"
    joint = Joint(
        name=name,
        kind="prismatic" if slides else "revolute",
        before=transform(origin),
        axis=axis / np.linalg.norm(axis),
        lower=number(keys.get("lower", 0 if name == "rail" else -np.inf)),
        upper=number(keys.get("upper", np.inf)),
        velocity=number(keys["velocity"]),
    )
    return [joint, Joint(name="", kind="fixed", before=transform(-origin), axis=np.zeros(3))]


class Cell:
    """The two chains of a cell: from the floor to the tool, and from the floor to the path."""

    def __init__(self, job_file):
        job = yaml.safe_load(Path(job_file).read_text(encoding="utf-8"))
        arm = job["arm"]
        self.to_tool = []
        self.to_part = []
        if "file" in arm:
            description = Description(Path(job_file).parent / arm["file"])
            base = arm.get("base", description.root())
            self.to_tool = description.chain(base, arm.get("tip", "tool0"))
            if "part" in arm:
                self.to_part = description.chain(base, arm["part"])
        else:
            self.to_tool = ur10e_joints()
        if "rail" in arm:
            self.to_tool = [*of_keys("rail", arm["rail"]), *self.to_tool]
        for keys in arm.get("positioner", {}).get("axes", ()):
            self.to_part += of_keys(keys["name"], keys)
        self.tool_frame = of_frame(arm.get("tool"))
        # Of a robot description with `part`, the path is in the frame of that link.
        self.path_frame = of_frame(arm.get("work")) @ of_frame(job["path"].get("frame"))
        self.job = job

    def joints(self):
        """The joints that move, by name."""
        chains = [*self.to_tool, *self.to_part]
        return {x.name: x for x in chains if x.name and x.factor == 1.0}

    def pose(self, chain, q):
        """Pose at the end of a chain, for joint positions by name with shape (n,) each."""
        count = len(next(iter(q.values())))
        found = np.tile(np.eye(4), (count, 1, 1))
        for joint in chain:
            found = found @ joint.before
            if joint.kind == "fixed":
                continue
            moved = np.tile(np.eye(4), (count, 1, 1))
            position = joint.factor * q[joint.name]
            if joint.kind == "prismatic":
                moved[:, :3, 3] = position[:, None] * joint.axis
            else:
                moved[:, :3, :3] = about(joint.axis, position)
            found = found @ moved
        return found

    def tool(self, q):
        """Pose of the tool relative to the floor."""
        return self.pose(self.to_tool, q) @ self.tool_frame

    def path_poses(self, q):
        """Pose of the path's coordinates relative to the floor."""
        return self.pose(self.to_part, q) @ self.path_frame

    def tool_in_path(self, q):
        """Pose of the tool in the coordinates of the path."""
        return inverse(self.path_poses(q)) @ self.tool(q)


@dataclass(frozen=True)
class Motion:
    """Samples of a motion: times with shape (n,), and values by joint with shape (n,) each."""

    t: np.ndarray
    q: dict
    dq: dict
    ddq: dict


def read_motion(file):
    """Read a table `planned.csv`."""
    with Path(file).open(encoding="utf-8") as lines:
        head, *rows = csv.reader(lines)
    values = np.array(rows, float).T
    found = {"q": {}, "dq": {}, "ddq": {}}
    for title, column in zip(head[1:], values[1:], strict=True):
        kind, name = re.fullmatch(r"(\w+) (.+) \[.*\]", title).groups()
        found[kind][name] = column
    return Motion(t=values[0], **found)


def between_samples(motion, count=8):
    """Positions by quintic Hermite interpolation at `count` times within each interval."""
    step = np.diff(motion.t)
    u = np.arange(count) / count
    found = {}
    for name, q in motion.q.items():
        velocity = motion.dq[name][:, None]
        acceleration = motion.ddq[name][:, None]
        a = q[:-1, None]
        b = q[1:, None]
        va = velocity[:-1] * step[:, None]
        vb = velocity[1:] * step[:, None]
        aa = acceleration[:-1] * step[:, None] ** 2
        ab = acceleration[1:] * step[:, None] ** 2
        c3 = 10 * (b - a) - 6 * va - 4 * vb - 1.5 * aa + 0.5 * ab
        c4 = -15 * (b - a) + 8 * va + 7 * vb + 1.5 * aa - ab
        c5 = 6 * (b - a) - 3 * va - 3 * vb - 0.5 * aa + 0.5 * ab
        inner = a + va * u + aa / 2 * u**2 + c3 * u**3 + c4 * u**4 + c5 * u**5
        found[name] = np.append(inner.ravel(), q[-1])
    return found
