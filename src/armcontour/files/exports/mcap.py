"""Motions as a bag of ROS 2 (.mcap), for viewers such as Foxglove, rerun and PlotJuggler."""

from __future__ import annotations

import heapq
import json
import math
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.frames import quaternions
from armcontour.core.sampled_data import interpolate
from armcontour.files.bag_messages import (
    CONTROLLER_STATE,
    JOINT_STATE,
    LAYOUTS,
    NANOSECONDS,
    NEW_POINTS,
)
from armcontour.files.exports.export_table import SetPointTable, event_data, regular_times
from armcontour.files.ros_bag import MISSING_LIBRARY
from armcontour.motion import Execution, Trajectory
from armcontour.robot import Arm
from armcontour.robot.chain import floor_poses

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

# Stamp of the first point [ns]. A stamp of 0 means "no time" or "the newest" in ROS.
FIRST_STAMP = 1_000_000_000
# Frames of TF: that of the arm's base, or of the floor under its rail; the work frame, in which
# paths are given; the tool of the executed and of the planned motion.
BASE = "base"
PART = "part"
TOOL = "tool"
PLANNED_TOOL = "planned_tool"
# Largest number of poses in a path. Of a longer motion, every second, third, ... pose is written.
MAX_POSES = 10_000
POSE = "geometry_msgs/msg/PoseStamped"
PATH = "nav_msgs/msg/Path"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
TEXT = "std_msgs/msg/String"
# A message: its stamp [ns], topic, type and content.
Message = tuple[int, str, str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class _Motion:
    """Joint motion for topics of one name."""

    name: str  # "planned", "commanded" or "executed", the beginning of its topics
    t: FloatArray  # Times since the first point [s], (n,)
    q: FloatArray  # Joint positions [rad], (n, dof)
    dq: FloatArray | None = None  # Joint velocities [rad/s], (n, dof); None if unknown
    effort: FloatArray | None = None  # Torques [N m], (n, dof); None if unknown
    tool: str = ""  # Frame of its tool in TF; empty if the tool is not written


def write_mcap(
    table: SetPointTable,
    file: FilePath,
    *,
    arm: Arm | None = None,
    plan: Trajectory | None = None,
    execution: Execution | None = None,
) -> None:
    """Write motions as messages of ROS 2 in an MCAP file.

    Topics are `/commanded/joint_states` with the points of the table, `/planned/...` and
    `/executed/...` with joint states, with poses of the tool and its path if the arm is known,
    `/controller_state` with commands and executed positions, `/events`, `/tf` and `/tf_static`.

    Args:
        table: The points.
        file: File to write.
        arm: The arm; None for joints only.
        plan: The planned motion; None if it is not written.
        execution: The predicted motion; None if it is not written.

    Raises:
        InvalidInput: rosbags is not installed, or a motion has another number of joints.
    """
    for owner, motion in (("The arm", arm), ("The plan", plan)):
        _check_dof(table, owner, None if motion is None else motion.dof)
    _check_dof(table, "The execution", None if execution is None else execution.q.shape[1])
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise InvalidInput(MISSING_LIBRARY.format(task="Writing MCAP files")) from None
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(LAYOUTS[0].definition, CONTROLLER_STATE))
    streams = _streams(_Maker(store), table, arm, plan, execution)
    # rosbags writes a folder with the file and its metadata, which the file contains too.
    with tempfile.TemporaryDirectory(dir=file.parent) as folder:
        bag = FilePath(folder) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topics: dict[str, Any] = {}
            for stamp, topic, kind, message in heapq.merge(*streams, key=lambda x: x[0]):
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(topics[topic], stamp, store.serialize_cdr(message, kind))
        shutil.move(bag / "bag.mcap", file)


def _check_dof(table: SetPointTable, owner: str, dof: int | None) -> None:
    """Raise ArmMismatch if an arm or a motion has another number of joints than the table."""
    if dof not in (None, table.dof):
        raise ArmMismatch(f"{owner} has {dof} joints, but {table.name!r} has {table.dof}.")


class _Maker:
    """Makes messages of ROS 2 from arrays."""

    def __init__(self, store: Typestore) -> None:
        self.types: dict[str, Any] = {x.rpartition("/")[2]: y for x, y in store.types.items()}

    def make(self, name: str, *values: Any) -> Any:
        """Return a message of a type, such as Header, with the values of its fields."""
        return self.types[name](*values)

    def header(self, stamp: int, frame: str) -> Any:
        """Return the header of a message."""
        return self.make("Header", self.make("Time", *divmod(stamp, NANOSECONDS)), frame)

    def joint_state(
        self, stamp: int, names: Sequence[str], q: FloatArray, dq: FloatArray, effort: FloatArray
    ) -> Any:
        """Return the state of joints; unknown arrays are empty."""
        return self.make("JointState", self.header(stamp, BASE), list(names), q, dq, effort)

    def point(self, *arrays: FloatArray) -> Any:
        """Return a point of a trajectory with positions, velocities, ...; others are empty."""
        rest = [np.zeros(0)] * (4 - len(arrays))
        return self.make("JointTrajectoryPoint", *arrays, *rest, self.make("Duration", 0, 0))

    def pose(self, matrix: FloatArray, quaternion: FloatArray) -> Any:
        """Return a pose with the position of a matrix, (3, 4)."""
        position = self.make("Point", *matrix[:, 3].tolist())
        return self.make("Pose", position, self.make("Quaternion", *quaternion.tolist()))

    def transform(
        self, stamp: int, parent: str, child: str, matrix: FloatArray, quaternion: FloatArray
    ) -> Any:
        """Return the transform from a frame to its parent, for TF."""
        shift = self.make("Vector3", *matrix[:, 3].tolist())
        rotation = self.make("Quaternion", *quaternion.tolist())
        header = self.header(stamp, parent)
        return self.make("TransformStamped", header, child, self.make("Transform", shift, rotation))


def _streams(
    maker: _Maker,
    table: SetPointTable,
    arm: Arm | None,
    plan: Trajectory | None,
    execution: Execution | None,
) -> Iterator[Iterator[Message]]:
    """Yield the messages of each topic, or of topics that belong together, in order of stamps."""
    motions = _motions(table, plan, execution)
    for motion in motions:
        yield _joint_states(maker, table.joint_names, motion)
        if arm is not None and motion.tool:
            yield _tool_messages(maker, arm, motion)
    if arm is not None and any(x.tool for x in motions):
        yield _part_messages(maker, arm, next(x for x in motions[::-1] if x.tool))
    if execution is not None:
        yield _controller_states(maker, table, motions[-1])
    yield _event_messages(maker, table)


def _motions(
    table: SetPointTable, plan: Trajectory | None, execution: Execution | None
) -> list[_Motion]:
    """Return the motions to write; their times count from the first point of the table."""
    motions = [_Motion("commanded", table.t, table.q, table.dq)]
    if plan is not None:
        samples = plan.sample(table.cycle)
        t = samples.t - table.start_time
        motions.append(_Motion("planned", t, samples.q, samples.dq, tool=PLANNED_TOOL))
    if execution is not None:
        # The samples are those that a controller with this cycle publishes.
        end = float(execution.t[-1]) - table.start_time
        t = regular_times(math.floor(end / table.cycle + 1e-9) + 1, table.cycle)
        at = t + table.start_time
        torque = execution.torque
        motions.append(
            _Motion(
                "executed",
                t,
                interpolate(at, execution.t, execution.q),
                interpolate(at, execution.t, execution.dq),
                None if torque is None else interpolate(at, execution.t, torque),
                tool=TOOL,
            )
        )
    return motions


def _rows(values: FloatArray) -> FloatArray:
    """Return an array whose rows are contiguous, as rosbags requires, (n, dof)."""
    return np.ascontiguousarray(values, dtype=np.float64)


def _stamps(t: FloatArray) -> IntArray:
    """Return times since the first point [s] as stamps [ns], (n,)."""
    return np.rint(t * 1e9).astype(np.int64) + FIRST_STAMP


def _joint_states(maker: _Maker, names: Sequence[str], motion: _Motion) -> Iterator[Message]:
    """Yield the joint states of a motion."""
    empty = np.zeros((len(motion.t), 0))
    q = _rows(motion.q)
    dq = empty if motion.dq is None else _rows(motion.dq)
    effort = empty if motion.effort is None else _rows(motion.effort)
    topic = f"/{motion.name}/joint_states"
    for i, stamp in enumerate(_stamps(motion.t).tolist()):
        state = maker.joint_state(stamp, names, q[i], dq[i], effort[i])
        yield stamp, topic, JOINT_STATE, state


def _tool_messages(maker: _Maker, arm: Arm, motion: _Motion) -> Iterator[Message]:
    """Yield the path of a motion's tool, and then its poses, as messages and in TF."""
    matrices = arm.poses(motion.q)
    rotations = quaternions(matrices[..., :3])
    stamps = _stamps(motion.t).tolist()
    poses = []
    for i, stamp in enumerate(stamps):
        pose = maker.pose(matrices[i], rotations[i])
        poses.append(maker.make("PoseStamped", maker.header(stamp, PART), pose))
    step = math.ceil(len(poses) / MAX_POSES)
    # The last pose always belongs to the path.
    shown = poses[:-1:step] + poses[-1:]
    path = maker.make("Path", maker.header(stamps[0], PART), shown)
    yield stamps[0], f"/{motion.name}/path", PATH, path
    for i, stamp in enumerate(stamps):
        yield stamp, f"/{motion.name}/tool", POSE, poses[i]
        transform = maker.transform(stamp, PART, motion.tool, matrices[i], rotations[i])
        yield stamp, "/tf", TRANSFORMS, maker.make("TFMessage", [transform])


def _part_messages(maker: _Maker, arm: Arm, motion: _Motion) -> Iterator[Message]:
    """Yield the frame of the part in that of the base: once, unless a positioner moves the part."""
    moves = arm.chain.positioner is not None
    q = motion.q if moves else motion.q[:1]
    floor = floor_poses(arm.chain, q)
    # The floor is given in the frame of the part, and TF needs the inverse.
    rotation = np.swapaxes(floor[..., :3], 1, 2)
    position = -(rotation @ floor[..., 3:])
    matrices = np.concatenate([rotation, position], axis=2)
    turns = quaternions(rotation)
    for i, stamp in enumerate(_stamps(motion.t[: len(q)]).tolist()):
        transform = maker.transform(stamp, BASE, PART, matrices[i], turns[i])
        topic = "/tf" if moves else "/tf_static"
        yield stamp, topic, TRANSFORMS, maker.make("TFMessage", [transform])


def _controller_states(maker: _Maker, table: SetPointTable, executed: _Motion) -> Iterator[Message]:
    """Yield commands and executed positions, as a trajectory controller publishes them."""
    nowhere = maker.make("MultiDOFJointTrajectoryPoint", [], [], [], maker.make("Duration", 0, 0))
    names = list(table.joint_names)
    positions = _rows(executed.q)
    velocities = None if executed.dq is None else _rows(executed.dq)
    # A command stays until the next one, and after the last one. Both times have rounding errors.
    rows = np.searchsorted(table.t, executed.t + 1e-9 * table.cycle, side="right") - 1
    commands = _rows(table.q)[rows]
    for i, stamp in enumerate(_stamps(executed.t).tolist()):
        command = commands[i]
        q = positions[i]
        velocity = () if velocities is None else (velocities[i],)
        points = {
            "reference": maker.point(command),
            "feedback": maker.point(q, *velocity),
            "error": maker.point(command - q),
            "output": maker.point(),
        }
        state = maker.make(
            "JointTrajectoryControllerState",
            maker.header(stamp, BASE),
            names,
            *(points[x] for x in NEW_POINTS),
            [],
            *[nowhere] * len(NEW_POINTS),
            1.0,
        )
        yield stamp, "/controller_state", CONTROLLER_STATE, state


def _event_messages(maker: _Maker, table: SetPointTable) -> Iterator[Message]:
    """Yield the events of a table as texts in JSON."""
    for event in table.events:
        stamp = int(_stamps(np.array([event.t]))[0])
        yield stamp, "/events", TEXT, maker.make("String", json.dumps(event_data(event)))
