"""Logs of a robot in the Studio: storage, identification, learning."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.files.bags import STATE, controller_state, write_db3
from tests.studio.robot_logs import HEAD, TRUE, write_table
from tests.studio.session_pages import RecordingTaskWorker, SessionPage, figure, session_of

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.core.render import cells
from armcontour.files import parse_job
from armcontour.files.log_file import read_log, read_run_log
from armcontour.jobs.run_learning import learn_logs
from armcontour.studio.opening import MAX_LOGS
from armcontour.studio.recent import state_folder
from armcontour.studio.tasks.dispatch import do


def quiet(step):
    """Hears nothing."""


@pytest.fixture(scope="module")
def file(robot):
    return robot.file


@pytest.fixture(scope="module")
def done(robot):
    return robot.execute()


@pytest.fixture
def ask(file):
    """What a task makes of logs."""

    def ask_task(task, *logs, text=None, **options):
        request = {"text": text or file.read_text(), "folder": str(file.parent), "run": "optimal"}
        request |= {"logs": [str(x) for x in logs], "options": options}
        return do(task, request, quiet)

    return ask_task


def test_the_identified_servo_is_written_into_the_job(ask, file, log):
    frame = ask("identify", log)
    logged = read_log(log)
    identification = ac.identify(logged, ac.ServoFit(kinematics=ac.load_arm("pmk3s")))
    tables = {x["title"]: x["cells"] for x in frame.header["tables"]}
    assert tables == {x.name: cells(x) for x in identification.to_data().tables}
    now, then = (figure(frame.header, x) for x in ("error_now", "error_then"))
    assert 0 < then < now
    ((label, (edit,)),) = (x.values() for x in frame.header["changes"])
    assert label == "Use this servo" and frame.header["kept"]
    before = file.read_text()
    session = session_of(file)
    session.begin()
    tab = SessionPage(session)
    tab.edit(edit)
    text = session.editor.document.text
    servo = parse_job(text).servo
    np.testing.assert_allclose(servo.kp, TRUE.kp, rtol=0.01)
    np.testing.assert_allclose(servo.kv, TRUE.kv, rtol=0.01)
    np.testing.assert_allclose(servo.kp, identification.servo_model().kp, rtol=1e-5)
    assert tab.last("document")["undo_label"] == "set servo"
    tab.say("undo")
    assert session.editor.document.text == before
    session.close()


def test_a_servo_is_offered_if_a_joint_rests_in_the_log(ask, robot, tmp_path):
    """The joint that moves has its identified gains, the other one keeps those of the job."""
    rows = robot.table(robot.execute())
    rows[:, [2, 4]] = -1.0
    frame = ask("identify", write_table(tmp_path / "resting.csv", rows))
    assert frame.header["kept"] is True
    (change,) = frame.header["changes"]
    assert "command 2" in change["label"] or robot.job.arm.joint_names[1] in change["label"]
    (edit,) = change["edits"]
    assumed = np.broadcast_to(robot.job.servo.kp, 2)
    assert edit["key"] == "servo"
    np.testing.assert_allclose(edit["value"]["kp"], [TRUE.kp, assumed[1]], rtol=0.01)
    assert edit["value"]["kp"][1] == assumed[1] != TRUE.kp


def test_rounding_errors_of_the_clock_change_no_parameter(log):
    """Without a dead time, the best dead time is next to its bound, where searches creep."""
    logged = read_log(log)
    fit = ac.ServoFit(kinematics=ac.load_arm("pmk3s"))
    joints = ac.identify(logged, fit).joints
    noise = 1e-13 * np.random.default_rng(2).standard_normal(len(logged.t))
    shifted = replace(logged, t=logged.t - logged.t[0] + noise)
    for before, after in zip(joints, ac.identify(shifted, fit).joints, strict=True):
        assert before.order == after.order == "second"
        for name in ("kp", "kv", "dead_time"):
            first, second = getattr(before, name), getattr(after, name)
            np.testing.assert_allclose(second.value, first.value, rtol=0, atol=0.01 * first.sd)


def test_the_next_set_points_equal_those_of_the_command_learn(ask, robot, file, log, command):
    first, second, third = (robot.folder / x for x in ("first", "second", "third"))
    assert command("run", file, "--out", first, "--no-simulation")[0] == 0
    assert command("learn", file, "--set-points", first, "--log", log, "--out", second)[0] == 0
    frame = ask("learn", log)
    content = frame.arrays["content"].tobytes()
    assert content == (second / "optimal/set_points.csv").read_bytes()
    assert frame.header["label"] == "Download next set-points"
    # The robot executes them, and the error of the next log is that of its tool.
    learned = np.loadtxt(second / "optimal/set_points.csv", delimiter=",", skiprows=1)
    moved = robot.execute(replace(robot.plan.set_points, q=learned[:, 1:]))
    again = robot.log(robot.folder / "run2.csv", moved, seed=1)
    frame = ask("learn", log, again)
    true = ac.evaluate(moved, robot.plan.path).contour_error.rms
    logs = [read_run_log(x, robot.job.arm.joint_names) for x in (log, again)]
    lesson = learn_logs(robot.job, robot.plan, logs)
    assert lesson.runs[1].contour_rms == pytest.approx(true, rel=0.05)
    assert frame.header["tables"][0]["cells"] == cells(lesson.to_data().tables[0])
    assert command("learn", file, "--set-points", second, "--log", again, "--out", third)[0] == 0
    content = frame.arrays["content"].tobytes()
    assert content == (third / "optimal/set_points.csv").read_bytes()
    exported = ask("export", log, format="csv", of="learned").arrays["content"].tobytes()
    rows = np.loadtxt(exported.decode().splitlines(), delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:, 1:3], learned[:, 1:], atol=1e-9)


def test_logs_of_another_job_are_refused(ask, robot, done, tmp_path):
    rows = robot.table(done)
    mirrored = rows.copy()
    mirrored[:, 1:] = rows[::-1, 1:]
    turned = rows.copy()
    turned[:, 1:] = np.degrees(turned[:, 1:])
    both = ("learn",)
    every = ("learn", "identify")
    single = "t [s],command 1 [rad],measured 1 [rad]"
    for tasks, table, head, words in (
        (every, rows[:, [0, 1, 3]], single, "1 joint .* arm has 2"),
        (both, rows + [0, *[0.3] * 4], HEAD, "other set-points or of another arm"),
        (both, mirrored, HEAD, "log of another job"),
        (both, rows[::30], HEAD, "60 ms"),
        (every, rows * [1e3, 1, 1, 1, 1], HEAD, "s"),
        (both, rows[: len(rows) // 2], HEAD, "Record the whole run"),
        (both, rows[:, [0, 2, 1, 4, 3]], HEAD, "another unit, sign or order"),
        (both, turned, HEAD, "another unit|degrees"),
        (("identify",), rows[:, [0, 3, 4]], "t,q1,q2", "no command column"),
        (every, rows[:20], HEAD, "at least 50"),
    ):
        log = write_table(tmp_path / "bad.csv", table, head)
        for task in tasks:
            with pytest.raises(InvalidInput, match=words) as refused:
                ask(task, log)
            # One sentence, which names the log and not where it is kept.
            assert "bad.csv" in str(refused.value) and str(tmp_path) not in str(refused.value)
    for task in (*every, "export"):
        with pytest.raises(InvalidInput, match="requires a log"):
            ask(task, of="learned")
    for content in (bytes(range(256)) * 40, b"\x1f\x8b\x08" + bytes(200), b"x"):
        log.write_bytes(content)
        for task in every:
            with pytest.raises(InvalidInput, match=r"bad\.csv") as refused:
                ask(task, log)
            assert str(tmp_path) not in str(refused.value)


def test_a_refusal_of_columns_names_the_field_of_the_task(ask, robot, done, tmp_path):
    rows = robot.table(done)
    log = write_table(tmp_path / "other.csv", rows, "t [s],cmd_1,cmd_2,act_1,act_2")
    for task in ("learn", "identify"):
        with pytest.raises(InvalidInput, match="the field columns") as refused:
            ask(task, log)
        assert "--columns" not in str(refused.value)
        # What the sentence proposes is accepted by the field.
        proposed = re.search(r"with (\S+) in the field columns", str(refused.value))[1]
        assert "u#=cmd_#" in proposed or "u1=" in proposed, proposed
    frame = ask("identify", log, columns="u# [rad]=cmd_#,q# [rad]=act_#")
    assert frame.header["kept"]


def test_logs_are_kept_in_the_folder_of_the_user_until_the_session_ends(file, home):
    session = session_of(file)
    session.begin()
    tab = SessionPage(session)
    uploads = session.editor.uploads
    assert tab.last("document")["logs"] == []
    before = sorted(file.parent.rglob("*"))
    session.open_upload("run.csv", b"t,q1\n", None, log=True)
    session.open_upload("run.csv", b"t,q1\n", None, log=True)
    session.open_upload("run.csv", b"t,q2\n", None, log=True)
    names = tab.last("document")["logs"]
    assert len(names) == 2 and names[0] == "run.csv" and names[1].endswith("run.csv")
    assert not session.editor.document.undo_label
    assert all(x.is_relative_to(state_folder()) for x in uploads.logs.values())
    assert all(x.parent.stat().st_mode & 0o077 == 0 for x in uploads.logs.values())
    tab.say("task", id="t1", task="learn", options={"logs": names[::-1]})
    _, _, request = RecordingTaskWorker.last.given[-1]
    read = [Path(x).read_bytes() for x in request["logs"]]
    assert read == [b"t,q2\n", b"t,q1\n"]
    count = len(RecordingTaskWorker.last.given)
    for names in (["other.csv"], ["../job.yaml"], [str(file)], "run.csv", [["run.csv"]], {}, 5):
        frames = tab.say("task", id="t2", task="learn", options={"logs": names})
        # Nothing chosen is what the task itself refuses.
        assert names == {} or frames[-1].kind == "failed", names
    assert len(RecordingTaskWorker.last.given) == count + 1
    for name in (
        "../a.csv",
        "a/../b.csv",
        ".csv",
        "a.yaml",
        "a.npz",
        "a.csv.gz",
        "a.zip",
        "C:\\a.csv",
    ):
        with pytest.raises(InvalidInput):
            session.open_upload(name, b"t,q1\n", None, log=True)
    with pytest.raises(InvalidInput, match="empty"):
        session.open_upload("a.csv", b"", None, log=True)
    for k in range(MAX_LOGS + 2):
        session.open_upload("run.csv", b"%d" % k, None, log=True)
    assert len(tab.last("document")["logs"]) == MAX_LOGS
    log_files = list(uploads.logs.values())
    assert sorted(log_files[0].parent.iterdir()) == sorted(log_files)
    session.close()
    assert not any(x.is_file() for x in (home / "armcontour" / "studio" / "uploads").rglob("*"))
    assert sorted(file.parent.rglob("*")) == before


def test_a_bag_of_ros_is_a_log(ask, file, log, robot, tmp_path):
    """The bag has the samples of the table, for two controllers."""
    pytest.importorskip("rosbags")
    rows = np.genfromtxt(log, delimiter=",", skip_header=1)
    messages = []
    for topic in ("/a/controller_state", "/b/controller_state"):
        for row in rows:
            stamp = int(round(row[0] * 1e9))
            data = controller_state(["joint 1", "joint 2"], stamp, row[1:3], row[3:5])
            messages.append((topic, STATE, stamp, data))
    bag = write_db3(tmp_path / "run.db3", messages)
    with pytest.raises(InvalidInput, match="/a/controller_state.*/b/controller_state"):
        ask("identify", bag)
    of_bag = ask("identify", bag, topic="/b/controller_state").header
    of_table = ask("identify", log).header
    assert of_bag["tables"] == of_table["tables"]
    session = session_of(file)
    assert session.editor.uploads.keep_log("run.db3", bag.read_bytes()) == "run.db3"
