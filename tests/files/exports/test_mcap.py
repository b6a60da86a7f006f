"""MCAP files of a run: decoded here, read by rosbags, and read again as logs."""

import struct

import numpy as np
import pytest
from tests.files.bags import Decoder

import armcontour as ac
from armcontour.core.errors import ArmMismatch
from armcontour.files.exports import McapFormat
from armcontour.files.log_file import log_text

pytest.importorskip("rosbags")

MAGIC = b"\x89MCAP0\r\n"
FIRST = 10**9
CYCLE = 0.004
JOB = """
name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]}
limits: {speed: 0.10 m/s}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s, dead_time: 12 ms}
cycle: 4 ms
process: {switch: {name: laser}}
runs: {plain: {compensation: {method: none}}, inverse: {}}
export: {formats: [mcap]}
"""


def text_at(data, place):
    (size,) = struct.unpack_from("<I", data, place)
    return data[place + 4 : place + 4 + size].decode(), place + 4 + size


def records(data, place=0):
    """Records of MCAP: operation codes and contents; those in a chunk follow it."""
    while place < len(data) and data[place : place + 8] != MAGIC:
        code, size = struct.unpack_from("<BQ", data, place)
        content = data[place + 9 : place + 9 + size]
        yield code, content
        if code == 6:
            compression, after = text_at(content, 28)
            assert compression == ""
            yield from records(content[after + 8 :])
        place += 9 + size


def messages_of(file):
    """Messages of an MCAP file by topic: type of the topic, and stamps [ns] with contents."""
    data = file.read_bytes()
    assert data.startswith(MAGIC) and data.endswith(MAGIC)
    kinds = {}
    topics = {}
    found = {}
    last = 0
    for code, content in records(data, 8):
        if code == 3:
            kinds[struct.unpack_from("<H", content)[0]] = text_at(content, 2)[0]
        if code == 4:
            channel, kind = struct.unpack_from("<HH", content)
            topics[channel] = text_at(content, 4)[0], kinds[kind]
        if code == 5:
            channel, _, stamp, _ = struct.unpack_from("<HIQQ", content)
            topic, kind = topics[channel]
            found.setdefault(topic, (kind, []))[1].append((stamp, content[22:]))
            assert stamp >= last
            last = stamp
    return found


def joint_states(messages):
    """Times since the first point [s], positions and velocities of a topic."""
    kind, rows = messages
    assert kind == "sensor_msgs/msg/JointState"
    t = []
    q = []
    dq = []
    for stamp, data in rows:
        cdr = Decoder(data)
        assert cdr.header()[0] == stamp
        assert cdr.texts() == ["joint 1", "joint 2"]
        t.append(1e-9 * (stamp - FIRST))
        q.append(cdr.numbers())
        dq.append(cdr.numbers())
        cdr.numbers()
        assert cdr.is_at_end
    return np.array(t), np.array(q), np.array(dq)


def pose(cdr):
    return np.array(cdr.numbers(3)), np.array(cdr.numbers(4))


def tool_of(q):
    """Position and angle of the tool of the PMK-3s: its base, and two links along y at q = 0."""
    total = q.sum(axis=1)
    x = 0.135 + 0.25 * np.sin(q[:, 0]) + 0.215 * np.sin(total)
    y = 0.25 * np.cos(q[:, 0]) + 0.215 * np.cos(total)
    return np.stack([x, y, 0 * x], axis=1), -total


@pytest.fixture(scope="module")
def job():
    return ac.files.parse_job(JOB)


@pytest.fixture(scope="module")
def motion(job):
    """Execution of compensated set-points, which begin before the plan."""
    plan = ac.plan(job.path, job.arm, job.runs[0].limits)
    set_points = ac.compensate(plan, job.servo, cycle=CYCLE)
    assert set_points.start_time < 0
    return ac.simulate(set_points, ac.ServoPlant(job.arm, job.servo))


@pytest.fixture(scope="module")
def file(motion, tmp_path_factory):
    file = tmp_path_factory.mktemp("mcap") / "run.mcap"
    ac.export(motion.set_points, file, McapFormat(execution=motion))
    return file


def test_joint_states_are_those_of_the_motions(motion, file):
    messages = messages_of(file)
    set_points = motion.set_points
    start = set_points.start_time
    t, q, _ = joint_states(messages["/commanded/joint_states"])
    np.testing.assert_allclose(t + start, set_points.t, rtol=0, atol=2e-9)
    np.testing.assert_array_equal(q, set_points.q)
    t, q, dq = joint_states(messages["/planned/joint_states"])
    assert t[0] + start == pytest.approx(0.0, abs=1e-9)
    plan = set_points.trajectory
    np.testing.assert_allclose(q, plan.with_rests(t + start), rtol=0, atol=1e-8)
    np.testing.assert_allclose(dq[1:-1], plan.with_rests(t + start, 1)[1:-1], rtol=0, atol=1e-6)
    t, q, dq = joint_states(messages["/executed/joint_states"])
    assert t[-1] + start == pytest.approx(motion.t[-1], abs=CYCLE)
    for j in range(2):
        expected = np.interp(t + start, motion.t, motion.q[:, j])
        np.testing.assert_allclose(q[:, j], expected, rtol=0, atol=1e-8)


def test_poses_of_the_tool_are_those_of_the_joints(file):
    messages = messages_of(file)
    for name, frame in (("planned", "planned_tool"), ("executed", "tool")):
        _, q, _ = joint_states(messages[f"/{name}/joint_states"])
        places, angles = tool_of(q)
        kind, rows = messages[f"/{name}/tool"]
        assert kind == "geometry_msgs/msg/PoseStamped" and len(rows) == len(q)
        kind, (path,) = messages[f"/{name}/path"]
        assert kind == "nav_msgs/msg/Path"
        whole = Decoder(path[1])
        assert whole.header() == (path[0], "part") and whole.take("I") == len(q)
        transforms = [Decoder(data) for _, data in messages["/tf"][1]]
        of_tool = []
        for x in transforms:
            assert x.take("I") == 1
            stamp, parent = x.header()
            if x.text() == frame:
                assert parent == "part"
                of_tool.append((stamp, *pose(x)))
        assert len(of_tool) == len(q)
        for i, (stamp, data) in enumerate(rows):
            cdr = Decoder(data)
            assert cdr.header() == (stamp, "part") == whole.header()
            for position, turn in (pose(cdr), pose(whole), of_tool[i][1:]):
                np.testing.assert_allclose(position, places[i], rtol=0, atol=1e-12)
                expected = [0.0, 0.0, np.sin(angles[i] / 2), np.cos(angles[i] / 2)]
                assert abs(turn @ expected) == pytest.approx(1.0, abs=1e-12)
            assert of_tool[i][0] == stamp and cdr.is_at_end
        assert whole.is_at_end
    ((_, data),) = messages["/tf_static"][1]
    cdr = Decoder(data)
    assert cdr.take("I") == 1 and cdr.header() == (FIRST, "base") and cdr.text() == "part"


def test_rosbags_reads_the_file(motion, file):
    from rosbags.highlevel import AnyReader

    with AnyReader([file]) as bag:
        assert bag.message_count == sum(len(x) for _, x in messages_of(file).values())
        (topic,) = (x for x in bag.connections if x.topic == "/controller_state")
        states = [bag.deserialize(data, topic.msgtype) for _, _, data in bag.messages([topic])]
    command = np.array([x.reference.positions for x in states])
    count = len(motion.set_points.q)
    np.testing.assert_array_equal(command[:count], motion.set_points.q)
    np.testing.assert_array_equal(command[count:], command[count - 1 : count] + 0 * command[count:])
    error = np.array([x.error.positions for x in states])
    feedback = np.array([x.feedback.positions for x in states])
    np.testing.assert_allclose(error, command - feedback, rtol=0, atol=1e-15)


def test_as_a_log_it_equals_the_table_of_the_run(job, motion, file, tmp_path):
    """Also what identify and check make of it."""
    set_points = motion.set_points
    log = ac.read_log(file)
    t = log.t + set_points.start_time
    measured = np.stack([np.interp(t, motion.t, x) for x in motion.q.T], axis=1)
    rows = np.minimum(np.rint(log.t / CYCLE).astype(int), len(set_points.q) - 1)
    table = ac.Log(t=CYCLE * np.arange(len(t)), command=set_points.q[rows], measured=measured)
    (tmp_path / "run.csv").write_text(log_text(table))
    written = ac.read_log(tmp_path / "run.csv")
    np.testing.assert_allclose(log.t, written.t, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(log.command, written.command)
    np.testing.assert_allclose(log.measured, written.measured, rtol=0, atol=1e-8)
    fits = [ac.identify(x) for x in (log, written)]
    for a, b in zip(fits[0].joints, fits[1].joints, strict=True):
        # Their positions differ by up to 1e-8 rad, which both fits see as noise.
        assert a.kp.value == pytest.approx(25.0, rel=1e-4)
        assert b.kp.value == pytest.approx(25.0, rel=1e-4)
    rates = np.stack([np.interp(t, motion.t, x) for x in motion.dq.T], axis=1)
    head = "t [s],q1,q2,dq1,dq2"
    rows = np.column_stack([CYCLE * np.arange(len(t)), measured, rates])
    np.savetxt(tmp_path / "q.csv", rows, "%.17g", ",", header=head, comments="")
    limits = job.runs[0].limits
    checks = [
        ac.check(ac.read_trajectory(x, job.arm.joint_names), job.arm, limits)
        for x in (file, tmp_path / "q.csv")
    ]
    assert checks[0].verdict == checks[1].verdict
    for a, b in zip(checks[0].uses, checks[1].uses, strict=True):
        assert a.name == b.name and a.value == pytest.approx(b.value, rel=1e-5)


def test_a_motion_without_arm_or_simulation_has_fewer_topics(motion, tmp_path):
    plan = motion.set_points.trajectory
    ac.export(plan, tmp_path / "plan.mcap", cycle=0.01)
    topics = set(messages_of(tmp_path / "plan.mcap"))
    tool = {f"/planned/{x}" for x in ("joint_states", "path", "tool")}
    assert topics == {"/commanded/joint_states", "/tf", "/tf_static", *tool}
    other = ac.load_arm("ur5e")
    with pytest.raises(ArmMismatch, match="6 joints"):
        ac.export(motion.set_points, tmp_path / "a.mcap", McapFormat(arm=other))


def test_jobs_write_one_file_with_all_motions(job, tmp_path):
    from tests.files.exports.added_format import command

    (tmp_path / "job.yaml").write_text(JOB)
    command("run", tmp_path / "job.yaml", "--out", tmp_path / "out")
    for name in ("plain", "inverse"):
        (file,) = (tmp_path / "out" / name / "export").iterdir()
        messages = messages_of(file)
        table = np.genfromtxt(
            tmp_path / "out" / name / "set_points.csv", delimiter=",", comments="#", skip_header=1
        )
        _, q, _ = joint_states(messages["/commanded/joint_states"])
        np.testing.assert_allclose(q, table[:, 1:3], rtol=0, atol=1e-9)
        assert {"/executed/path", "/planned/path", "/controller_state"} <= set(messages)
        laser = [Decoder(data).text() for _, data in messages["/events"][1]]
        assert '"laser"' in laser[0] and '"value": true' in laser[0]
    command("export", tmp_path / "out", tmp_path / "part.mcap", "--run", "plain")
    assert set(messages_of(tmp_path / "part.mcap")) == {"/commanded/joint_states", "/events"}
