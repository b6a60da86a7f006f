"""Bags of ROS 2 for tests, encoded here: CDR, and SQLite as Humble writes it. And CDR decoded."""

import sqlite3
import struct

JOINT_STATE = "sensor_msgs/msg/JointState"
STATE = "control_msgs/msg/JointTrajectoryControllerState"
NEW = ("reference", "feedback", "error", "output")
OLD = ("desired", "actual", "error")
# By release: points of a state, whether joints of several degrees of freedom follow, and a factor.
RELEASES = {
    "foxy": (OLD, False, False),
    "galactic": (OLD, True, False),
    "humble": ((*NEW, "desired", "actual"), True, False),
    "iron": (NEW, True, False),
    "jazzy": (NEW, True, True),
}
STAMP = 1_764_400_000_123_456_789


class Encoder:
    """Little-endian CDR; alignment counts from after the four bytes at the start."""

    def __init__(self):
        self.data = bytearray()

    def put(self, form, value):
        self.data += bytes(-len(self.data) % struct.calcsize(form))
        self.data += struct.pack(f"<{form}", value)

    def text(self, value):
        encoded = value.encode() + b"\0"
        self.put("I", len(encoded))
        self.data += encoded

    def texts(self, values):
        self.put("I", len(values))
        for x in values:
            self.text(x)

    def numbers(self, values):
        self.put("I", len(values))
        for x in values:
            self.put("d", float(x))

    def header(self, stamp, frame=""):
        self.put("i", stamp // 10**9)
        self.put("I", stamp % 10**9)
        self.text(frame)

    def point(self, positions=(), velocities=()):
        self.numbers(positions)
        self.numbers(velocities)
        self.numbers(())
        self.numbers(())
        self.put("i", 0)
        self.put("I", 0)

    @property
    def message(self):
        return b"\0\1\0\0" + bytes(self.data)


class Decoder:
    """Reads what CDR has, in the order of the fields."""

    def __init__(self, data):
        assert data[:4] == b"\0\1\0\0"
        self.data = data[4:]
        self.place = 0

    def take(self, form):
        size = struct.calcsize(form)
        self.place += -self.place % size
        (value,) = struct.unpack_from(f"<{form}", self.data, self.place)
        self.place += size
        return value

    def text(self):
        size = self.take("I")
        value = self.data[self.place : self.place + size - 1].decode()
        self.place += size
        return value

    def texts(self):
        return [self.text() for _ in range(self.take("I"))]

    def numbers(self, count=None):
        count = self.take("I") if count is None else count
        return [self.take("d") for _ in range(count)]

    def header(self):
        return self.take("i") * 10**9 + self.take("I"), self.text()

    @property
    def is_at_end(self):
        return len(self.data) - self.place < 4


def joint_state(names, stamp, q, dq=(), effort=()):
    message = Encoder()
    message.header(stamp)
    message.texts(names)
    for values in (q, dq, effort):
        message.numbers(values)
    return message.message


def controller_state(names, stamp, command, measured, dq=(), release="humble", filled=None):
    """State of a controller; `filled`: the points with positions, by default all of the release."""
    points, has_several, has_factor = RELEASES[release]
    message = Encoder()
    message.header(stamp)
    message.texts(names)
    values = {
        "reference": (command, ()),
        "desired": (command, ()),
        "feedback": (measured, dq),
        "actual": (measured, dq),
    }
    for x in points:
        is_filled = filled is None or x in filled
        message.point(*(values.get(x, ((), ())) if is_filled else ()))
    if has_several:
        message.texts(())
        for _ in points:
            for _ in range(3):
                message.put("I", 0)
            message.put("i", 0)
            message.put("I", 0)
    if has_factor:
        message.put("d", 1.0)
    return message.message


def write_db3(file, rows):
    """Write messages as rosbag2 of Humble does, without definitions.

    `rows`: topic, type, time of arrival [ns] and data of each message.
    """
    file.parent.mkdir(exist_ok=True)
    with sqlite3.connect(file) as base:
        base.executescript(
            "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);"
            "CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,"
            " metadata TEXT NOT NULL);"
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
            " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
            " timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
            "INSERT INTO schema VALUES(3, 'humble');"
        )
        topics = {(topic, kind): k for k, (topic, kind) in enumerate({x[:2]: 0 for x in rows}, 1)}
        for (topic, kind), k in topics.items():
            base.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", (k, topic, kind))
        for topic, kind, received, data in rows:
            values = (topics[topic, kind], received, data)
            base.execute("INSERT INTO messages VALUES(NULL, ?, ?, ?)", values)
    base.close()
    return file


def write_folder(folder, rows, *, storage="mcap", compression=None):
    """Write messages to the folder of a bag with rosbags; MCAP has definitions."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    points = "".join(f"trajectory_msgs/JointTrajectoryPoint {x}\n" for x in NEW)
    several = "".join(f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{x}\n" for x in NEW)
    definition = (
        f"std_msgs/Header header\nstring[] joint_names\n{points}string[] multi_dof_joint_names\n"
        f"{several}float64 speed_scaling_factor\n"
    )
    store.register(get_types_from_msg(definition, STATE))
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer(folder, version=9, storage_plugin=plugin)
    if compression is not None:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        kinds = {(topic, kind): None for topic, kind, *_ in rows}
        connections = {x: writer.add_connection(*x, typestore=store) for x in kinds}
        for topic, kind, received, data in rows:
            writer.write(connections[topic, kind], received, data)
    return folder
