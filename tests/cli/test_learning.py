"""`armcontour learn`: from log files of a robot."""

import json

import numpy as np
import pytest
from tests.cli.helpers import summary
from tests.corner_job import CORNER_JOB
from tests.loaded_robot import loaded_robot

from armcontour.cli.run_command import run_job
from armcontour.files import read_job
from armcontour.files.set_point_file import read_set_points
from armcontour.files.trajectory_file import read_run
from armcontour.jobs.run_learning import plan_run
from armcontour.simulation import simulate

DEGREES = np.degrees(1.0)
TITLES = "t [s],command 1 [deg],command 2 [deg],measured 1 [deg],measured 2 [deg]"
BEGUN = 1000.0033


class Shop:
    """A job, its first result, and a robot that is not quite known."""

    def __init__(self, folder):
        self.file = folder / "job.yaml"
        self.file.write_text(CORNER_JOB, encoding="utf-8")
        self.job = read_job(self.file)
        self.plan = plan_run(self.job, None)
        self.first = folder / "first"
        run_job(lambda _: self.job, self.first, simulate=False)
        self.table = self.executed(self.first, 0)

    def executed(self, set_points, number):
        """What a controller logs of set-points: t, commands, positions, at 125 Hz in degrees."""
        robot = loaded_robot(self.job, self.plan, number)
        execution = simulate(read_set_points(set_points, self.job, self.plan), robot)
        t = np.arange(execution.t[0] - 0.2, execution.t[-1] + 0.2, 0.008)
        noise = 1e-6 * np.random.default_rng(number).standard_normal((len(t), 2))
        u = np.stack(
            [np.interp(t, execution.set_points.t, x) for x in execution.set_points.q.T], axis=1
        )
        q = np.stack([np.interp(t, execution.t, x) for x in execution.q.T], axis=1) + noise
        return np.column_stack([t + BEGUN, u * DEGREES, q * DEGREES])


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    return Shop(tmp_path_factory.mktemp("shop"))


def written(folder, table, titles=TITLES, name="run.csv"):
    file = folder / name
    np.savetxt(file, table, "%.7f", ",", header=titles, comments="")
    return file


def test_two_runs_of_a_robot(command, shop, tmp_path, refused, done):
    log, out, third = written(tmp_path, shop.table), tmp_path / "second", tmp_path / "third"
    learn = ("learn", shop.file, "--log")
    shown = done(*learn, log, "--set-points", shop.first, "--out", out)
    assert "run.csv" in shown and "Continue with" in shown
    data = summary(out)
    present = {x.relative_to(out).as_posix() for x in out.rglob("*") if x.is_file()}
    assert set(data["files"]) == present - {".armcontour.json"}
    assert present >= {"only/set_points.csv", "only/lesson.npz", "only/planned.csv", "report.html"}
    first = data["learning"]["runs"][0]
    assert first["offset"] == pytest.approx(-BEGUN, abs=1e-4)
    assert not data["learning"]["finished"]
    assert 'id="learning"' in (out / "report.html").read_text(encoding="utf-8")

    # The file of set-points alone finds what was learned beside it.
    second = written(tmp_path, shop.executed(out, 1), name="run2.csv")
    options = ("--set-points", out / "only/set_points.csv", "--out", third)
    shown = done(*learn, second, *options)
    assert "run.csv" in shown and "run2.csv" in shown and "run 2" in shown
    runs = summary(third)["learning"]["runs"]
    assert runs[1]["contour_rms"] < 0.25 * runs[0]["contour_rms"]
    exported = tmp_path / "robot.csv"
    assert command("export", third, exported)[0] == 0
    assert len(exported.read_text().splitlines()) == 1 + len(read_run(third).set_points().t)

    # The log of the first run once more, and that of the second for the set-points of the first.
    rows = [
        (
            (log, "--set-points", out, "--out", "a"),
            ["run.csv contains the set-points of run 1 (run.csv)"],
        ),
        ((log, "--set-points", out, "--judge-only"), ["run.csv contains the set-points of run 1"]),
        (
            (second, "--set-points", shop.first, "--out", "a"),
            ["run2.csv is the log of another run"],
        ),
    ]
    assert refused(tmp_path, rows, codes=(2,), begin=learn) == []

    # The log of the second run, for which those of the job are taken without --set-points.
    judge = (*learn[:2], "--judge-only", "--json", "--log")
    for file, options, differs in (
        (second, (), True),
        (log, ("--set-points", shop.first), False),
        (second, ("--set-points", out), False),
    ):
        code, shown, _ = command(*judge, file, *options)
        run = json.loads(shown)["judged"]
        assert code == 0 and (run["set_points_off"] > 1e-4) is differs
        assert differs or run["set_points_off"] < 1e-5
        assert any("executed set-points (--set-points)" in x for x in run["notes"]) is differs


def test_recorded_set_points_stay_valid_with_another_servo(shop, tmp_path, refused, done):
    """`identify` changes the servo of the job after the log, and between runs."""
    log, out, third = written(tmp_path, shop.table), tmp_path / "second", tmp_path / "third"
    other = tmp_path / "other.yaml"
    servo = "{kp: 24 1/s, kv: 140 1/s, dead_time: 1 ms}"
    before = "{kp: 25 1/s, kv: 150 1/s}"
    other.write_text(CORNER_JOB.replace(before, servo), encoding="utf-8")
    done("learn", other, "--log", log, "--set-points", shop.first, "--out", out)
    first = summary(out)["learning"]["runs"][0]
    assert first["set_points_off"] < 1e-5
    second = written(tmp_path, shop.executed(out, 1), name="run2.csv")
    done("learn", shop.file, "--log", second, "--set-points", out, "--out", third)
    runs = summary(third)["learning"]["runs"]
    assert runs[1]["contour_rms"] < 0.25 * runs[0]["contour_rms"]
    # Another plan is refused.
    other.write_text(CORNER_JOB.replace("0.72 rad", "0.70 rad"), encoding="utf-8")
    rows = [((other, "--log", log, "--set-points", shop.first, "--out", "a"), ["start again"])]
    assert refused(tmp_path, rows, codes=(2,), begin=("learn",)) == []


def test_positions_of_the_tool(shop, tmp_path, refused, done):
    """A tracker, with a clock of its own, that sees links bend, which the encoders do not."""
    t, q = shop.table[:, 0] - BEGUN, np.radians(shop.table[:, 3:])
    bent = q + 1e-3 * np.sin(2 * np.pi * np.clip(t, 0, 2)[:, None] * [1.0, 1.5]) ** 2
    tool = np.column_stack([1e3 * t, 1e3 * shop.job.arm.tool_position(bent)])
    file = written(tmp_path, tool, "t [ms],x [mm],y [mm]", "tool.csv")
    points = shop.job.arm.tool_position(q) + [0.1, 0.0]
    other = written(tmp_path, np.column_stack([shop.table[:, 0], points]), "t,x,y", "other.csv")
    log, out = written(tmp_path, shop.table), tmp_path / "out"
    learn = ("learn", shop.file, "--set-points", shop.first, "--log", log, "--out", out)
    rows = [((other,), ["frame of the path"])]
    assert refused(tmp_path, rows, codes=(2,), begin=(*learn, "--tool-positions")) == []
    done(*learn, "--tool-positions", file)
    run = summary(out)["learning"]["runs"][0]
    inside = (t >= 0) & (t <= shop.plan.trajectory.duration)
    path = shop.plan.path.path
    distances = path.project(shop.job.arm.tool_position(bent[inside])).distance
    blind = path.project(shop.job.arm.tool_position(q[inside])).distance
    assert run["contour_rms"] == pytest.approx(np.sqrt(np.mean(distances**2)), rel=0.1)
    assert np.sqrt(np.mean(distances**2)) > 2 * np.sqrt(np.mean(blind**2))


def test_options_that_do_not_go_together(shop, tmp_path, refused):
    log = written(tmp_path, shop.table)
    rows = [
        ("", ["--set-points and --log"]),
        ("--set-points x --log y", ["--out"]),
        ("--set-points x --log y --out out --run other", ["no run 'other'", "only"]),
        ("--set-points x --log y --out out --to 5", ["--to", "unit"]),
        # The job is not that of the set-points.
        (
            ("--speed", "50 mm/s", "--set-points", shop.first, "--log", log, "--out", "out"),
            ["with the same options"],
        ),
    ]
    assert refused(tmp_path, rows, codes=(2,), begin=("learn", shop.file)) == []


def test_a_log_is_judged_without_learning(shop, tmp_path, done):
    log, out = written(tmp_path, shop.table), tmp_path / "judged"
    shown = done("learn", shop.file, "--log", log, "--judge-only", "--out", out)
    assert "run.csv" in shown and "Continue with" not in shown
    assert "Set-points of the next run" not in shown
    assert {x.name for x in out.iterdir()} == {".armcontour.json", "summary.json"}
    data = summary(out)
    judged = data["judged"]
    # What the log has, by the nearest places of its samples.
    t, q = shop.table[:, 0] - BEGUN, np.radians(shop.table[:, 3:])
    inside = (t >= 0) & (t <= shop.plan.trajectory.duration)
    distances = shop.plan.path.path.project(shop.job.arm.tool_position(q[inside])).distance
    assert judged["contour_error"]["max"] == pytest.approx(distances.max(), rel=0.05)
    assert judged["contour_error"]["rms"] == pytest.approx(np.sqrt(np.mean(distances**2)), rel=0.05)
    t_max = judged["contour_error"]["t_max"]
    assert abs(t_max - t[inside][distances.argmax()]) < 0.1 and data["units"]["tool_rms"] == "m"
    assert judged["contours"][0]["coverage_error"]["max"] > 0

    # The same as the errors from which it learns.
    arguments = ("learn", shop.file, "--set-points", shop.first, "--log", log, "--json")
    shown = done(*arguments, "--judge-only")
    learned = done(*arguments, "--out", tmp_path / "n")
    first = json.loads(learned)["learning"]["runs"][0]
    assert json.loads(shown)["judged"]["contour_rms"] == first["contour_rms"]
