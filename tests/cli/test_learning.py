"""`armcontour learn`: from log files of a robot, and on a simulated robot."""

from __future__ import annotations

import json

import numpy as np
import pytest
from soak.corner_job import CORNER_JOB
from soak.number_cases import ROBOT

from armcontour.cli.running import run_job
from armcontour.execution import execute
from armcontour.io import read_job
from armcontour.io.stored_run import read_run
from armcontour.io.taught_file import read_taught
from armcontour.jobs.learning import plan_run
from armcontour.jobs.unknown_robot import unknown_robot

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
        self.robot, _ = unknown_robot(self.job, self.plan, 0)
        self.table = self.executed(self.first, 0)

    def executed(self, taught, number):
        """What a controller logs of set-points: t, commands, positions, at 125 Hz in degrees."""
        done = execute(read_taught(taught, self.job, self.plan), self.robot(number))
        t = np.arange(done.t[0] - 0.2, done.t[-1] + 0.2, 0.008)
        noise = 1e-6 * np.random.default_rng(number).standard_normal((len(t), 2))
        u = np.stack([np.interp(t, done.taught.t, x) for x in done.taught.q.T], axis=1)
        q = np.stack([np.interp(t, done.t, x) for x in done.q.T], axis=1) + noise
        return np.column_stack([t + BEGUN, u * DEGREES, q * DEGREES])


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    return Shop(tmp_path_factory.mktemp("shop"))


def written(folder, table, titles=TITLES, name="run.csv"):
    file = folder / name
    np.savetxt(file, table, "%.7f", ",", header=titles, comments="")
    return file


def test_two_runs_of_a_robot(command, shop, tmp_path):
    log, out = written(tmp_path, shop.table), tmp_path / "second"
    code, shown, errors = command(
        "learn", shop.file, "--taught", shop.first, "--log", log, "--out", out
    )
    assert code == 0, errors
    assert "1: run.csv" in shown and "Go on: the next run should have" in shown
    data = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    present = {x.relative_to(out).as_posix() for x in out.rglob("*") if x.is_file()}
    assert set(data["files"]) == present - {".armcontour.json"}
    assert present >= {"only/taught.csv", "only/lesson.npz", "only/planned.csv", "report.html"}
    first = data["learning"]["runs"][0]
    # Whole command intervals may be taken for dead time of the robot.
    assert first["offset"] == pytest.approx(-BEGUN, abs=3 * shop.plan.taught.period)
    assert not data["learning"]["finished"]
    assert 'id="learning"' in (out / "report.html").read_text(encoding="utf-8")

    # The file of set-points alone finds what was learned beside it.
    log = written(tmp_path, shop.executed(out, 1), name="run2.csv")
    third = tmp_path / "third"
    code, shown, errors = command(
        "learn", shop.file, "--taught", out / "only/taught.csv", "--log", log, "--out", third
    )
    assert code == 0, errors
    assert "1: run.csv" in shown and "2: run2.csv (best)" in shown
    data = json.loads((third / "summary.json").read_text(encoding="utf-8"))
    runs = data["learning"]["runs"]
    assert runs[1]["contour_rms"] < 0.25 * runs[0]["contour_rms"]
    assert runs[1]["contour_rms"] <= runs[1]["bound"]
    exported = tmp_path / "robot.csv"
    assert command("export", third, exported)[0] == 0
    assert len(exported.read_text().splitlines()) == 1 + len(read_run(third).taught().t)

    # The log of the first run once more.
    log, again = written(tmp_path, shop.table), tmp_path / "again"
    code, _, errors = command("learn", shop.file, "--taught", out, "--log", log, "--out", again)
    assert code == 2 and "run.csv has the set-points of run 1 (run.csv)" in errors
    assert not again.exists()
    judge = ("learn", shop.file, "--judge-only", "--log")
    code, _, errors = command(*judge, log, "--taught", out)
    assert code == 2 and "run.csv has the set-points of run 1 (run.csv)" in errors

    # The log of the second run for the set-points of the first.
    second = ("learn", shop.file, "--taught", shop.first, "--log", tmp_path / "run2.csv")
    code, _, errors = command(*second, "--out", again)
    assert code == 2 and "run2.csv is the log of another run" in errors and not again.exists()

    # The log of the second run, for which those of the job are taken without --taught.
    second = tmp_path / "run2.csv"
    code, shown, errors = command(*judge, second, "--json")
    run = json.loads(shown)["judged"]
    assert code == 0 and run["set_points_off"] > 1e-4
    assert any("run2.csv are" in x and "give these as --taught" in x for x in run["notes"])
    for number, taught in ((1, shop.first), (2, out)):
        log = tmp_path / ("run.csv" if number == 1 else "run2.csv")
        code, shown, errors = command(*judge, log, "--taught", taught, "--json")
        run = json.loads(shown)["judged"]
        assert run["set_points_off"] < 1e-5 and not any("--taught" in x for x in run["notes"])


def test_positions_of_the_tool(command, shop, tmp_path):
    """A tracker, with a clock of its own, that sees links bend, which the encoders do not."""
    t, q = shop.table[:, 0] - BEGUN, np.radians(shop.table[:, 3:])
    bent = q + 1e-3 * np.sin(2 * np.pi * np.clip(t, 0, 2)[:, None] * [1.0, 1.5]) ** 2
    tool = np.column_stack([1e3 * t, 1e3 * shop.job.arm.forward(bent)])
    file = written(tmp_path, tool, "t [ms],x [mm],y [mm]", "tool.csv")
    log, out = written(tmp_path, shop.table), tmp_path / "out"
    code, _, errors = command(
        "learn", shop.file, "--taught", shop.first, "--log", log, "--tool-positions", file,
        "--out", out,
    )  # fmt: skip
    assert code == 0, errors
    run = json.loads((out / "summary.json").read_text(encoding="utf-8"))["learning"]["runs"][0]
    inside = (t >= 0) & (t <= shop.plan.trajectory.duration)
    path = shop.plan.path.path
    seen = path.project(shop.job.arm.forward(bent[inside])).distance
    blind = path.project(shop.job.arm.forward(q[inside])).distance
    assert run["contour_rms"] == pytest.approx(np.sqrt(np.mean(seen**2)), rel=0.1)
    assert np.sqrt(np.mean(seen**2)) > 2 * np.sqrt(np.mean(blind**2))


def test_positions_of_another_tool_are_refused(command, shop, tmp_path):
    points = shop.job.arm.forward(np.radians(shop.table[:, 3:])) + [0.1, 0.0]
    file = written(tmp_path, np.column_stack([shop.table[:, 0], points]), "t,x,y", "tool.csv")
    log, out = written(tmp_path, shop.table), tmp_path / "out"
    code, _, errors = command(
        "learn", shop.file, "--taught", shop.first, "--log", log, "--tool-positions", file,
        "--out", out,
    )  # fmt: skip
    assert code == 2 and "frame of the path" in errors and not out.exists()


def changed(columns, change):
    def make(table):
        found = table.copy()
        found[:, columns] = change(found[:, columns])
        return found

    return make


def other_job(table):
    """A log of another motion of the same length, from the same place."""
    found = table.copy()
    t = np.clip(table[:, 0] - BEGUN, 0.0, 2.0)
    for j in (0, 1):
        found[:, 1 + j] = table[0, 1 + j] + 5 * np.sin(3 * t * (j + 1))
        found[:, 3 + j] = np.interp(table[:, 0] - 0.04, table[:, 0], found[:, 1 + j])
    return found


BAD = {
    "of another job": (other_job, TITLES, []),
    "too short": (lambda x: x[:200], TITLES, ["record the whole run"]),
    "too coarse": (lambda x: x[::12], TITLES, ["samples"]),
    "joints swapped": (changed([1, 2, 3, 4], lambda x: x[:, [1, 0, 3, 2]]), TITLES, []),
    "degrees as radians": (lambda x: x, TITLES.replace("deg", "rad"), []),
    "radians as degrees": (changed([1, 2, 3, 4], np.radians), TITLES, []),
    "one joint": (lambda x: x[:, [0, 1, 3]], "t,u1 [deg],q1 [deg]", ["taught data has 2"]),
    "milliseconds": (lambda x: x, TITLES.replace("[s]", "[ms]"), ["record the whole run"]),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_log_is_one_sentence_and_nothing_is_written(command, shop, tmp_path, name):
    make, titles, words = BAD[name]
    log, out = written(tmp_path, make(shop.table), titles), tmp_path / "out"
    before = set(tmp_path.iterdir())
    code, shown, errors = command(
        "learn", shop.file, "--taught", shop.first, "--log", log, "--out", out
    )
    assert code == 2
    assert shown == "" and errors.count("\n") == 1
    assert errors.startswith("Error: run.csv") and not [x for x in words if x not in errors], errors
    assert set(tmp_path.iterdir()) == before


def test_a_log_without_set_points(command, shop, tmp_path):
    log = written(tmp_path, shop.table[:, [0, 3, 4]], "t,q1 [deg],q2 [deg]")
    code, shown, errors = command(
        "learn", shop.file, "--taught", shop.first, "--log", log, "--out", tmp_path / "out"
    )
    assert code == 0, errors
    data = json.loads((tmp_path / "out/summary.json").read_text(encoding="utf-8"))
    assert data["learning"]["predicted"] < data["learning"]["runs"][0]["contour_rms"]


def test_the_job_must_be_that_of_the_taught_data(command, shop, tmp_path):
    log = written(tmp_path, shop.table)
    given = ("--taught", shop.first, "--log", log, "--out", tmp_path / "out")
    code, _, errors = command("learn", shop.file, "--speed", "50 mm/s", *given)
    assert code == 2 and "with the same options" in errors and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((), ["--taught and --log", "--simulate"]),
        (("--taught", "x"), ["--taught and --log"]),
        (("--taught", "x", "--log", "y"), ["--out"]),
        (("--simulate", "2", "--log", "y"), ["--log goes with"]),
        (("--simulate", "2", "--from", "1 s"), ["--from goes with"]),
        (("--taught", "x", "--log", "y", "--seed", "1"), ["--seed goes with --simulate"]),
        (("--simulate", "2", "--open"), ["--open and --force go with --out"]),
        (("--simulate", "2", "--run", "other"), ["no run 'other'", "only"]),
        (("--taught", "x", "--log", "y", "--out", "{out}", "--to", "5"), ["--to", "unit"]),
        (("--taught", "{out}", "--log", "y", "--out", "{out}"), ["There is no"]),
    ],
)
def test_options_that_do_not_go_together(command, shop, tmp_path, given, words):
    out = tmp_path / "out"
    code, _, errors = command("learn", shop.file, *(x.format(out=out) for x in given))
    assert code == 2 and not [x for x in words if x not in errors], errors
    assert not out.exists()


def test_a_simulated_robot(command, shop, tmp_path):
    out = tmp_path / "out"
    code, shown, errors = command("learn", shop.file, "--simulate", "2", "--out", out, "--seed", 4)
    assert code == 0, errors
    assert "a payload of 0.12 kg" in shown and "Set-points of the next run" not in shown
    data = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert set(data["files"]) == {"report.html", "summary.json"}
    errors = [x["executed"]["rms"] for x in data["learning"]["runs"]]
    assert min(errors) < 0.1 * errors[0]
    # Set-points for a robot that does not exist are no robot program.
    code, _, said = command("export", out, tmp_path / "robot.csv")
    assert code == 2 and "simulated robot" in said


def test_an_arm_without_masses_has_no_simulated_bodies(command, tmp_path):
    (tmp_path / "robot.urdf").write_bytes(ROBOT)
    text = "arm: {file: robot.urdf, tip: tcp, locked: {lift: 0.1}}\n"
    text += "path: {points: [[0.40, 0.20, 0], [0.42, 0.20, 0]]}\n"
    text += "limits: {speed: 0.1, joint_acceleration: 1}\nservo: {kp: 25, kv: 150}\nname: bare\n"
    file, out = tmp_path / "job.yaml", tmp_path / "out"
    file.write_text(text + "runs: {only: {}}\n", encoding="utf-8")
    code, _, errors = command("learn", file, "--simulate", "1", "--out", out)
    assert code == 2 and "has no masses" in errors and errors.count("\n") == 1
    assert not out.exists()


def test_a_log_is_judged_without_learning(command, shop, tmp_path):
    log, out = written(tmp_path, shop.table), tmp_path / "judged"
    code, shown, errors = command("learn", shop.file, "--log", log, "--judge-only", "--out", out)
    assert code == 0, errors
    assert "contour error in run.csv" in shown and "Go on" not in shown
    assert "Set-points of the next run" not in shown
    assert {x.name for x in out.iterdir()} == {".armcontour.json", "report.html", "summary.json"}
    data = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    found = data["judged"]
    # What the log has, by the nearest places of its samples.
    t, q = shop.table[:, 0] - BEGUN, np.radians(shop.table[:, 3:])
    inside = (t >= 0) & (t <= shop.plan.trajectory.duration)
    off = shop.plan.path.path.project(shop.job.arm.forward(q[inside])).distance
    assert found["contour_error"]["max"] == pytest.approx(off.max(), rel=0.05)
    assert found["contour_error"]["rms"] == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.05)
    at = found["contour_error"]["t_max"]
    assert abs(at - t[inside][off.argmax()]) < 0.1 and data["units"]["tool_rms"] == "m"
    assert found["contours"][0]["missed"]["max"] > 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert 'id="judged"' in page and "as measured" in page

    # The same as the errors from which it learns.
    code, shown, errors = command(
        "learn", shop.file, "--taught", shop.first, "--log", log, "--judge-only", "--json"
    )
    assert code == 0, errors
    code, learned, errors = command(
        "learn", shop.file, "--taught", shop.first, "--log", log, "--out", tmp_path / "n", "--json"
    )
    assert code == 0, errors
    first = json.loads(learned)["learning"]["runs"][0]
    assert json.loads(shown)["judged"]["contour_rms"] == first["contour_rms"]


def test_judging_needs_a_log_and_no_simulation(command, shop):
    code, _, errors = command("learn", shop.file, "--judge-only")
    assert code == 2 and "--judge-only needs what the robot did, --log" in errors
    code, _, errors = command("learn", shop.file, "--judge-only", "--simulate", "2")
    assert code == 2 and "--judge-only goes with --log" in errors
