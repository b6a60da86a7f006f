"""The command `learn` with log files of a robot."""

import numpy as np
import pytest
from tests.cli.helpers import summary
from tests.corner_job import CORNER_JOB
from tests.loaded_robot import loaded_robot

from armcontour.cli.command_execution import execute
from armcontour.cli.commands import Run
from armcontour.cli.run_command import run
from armcontour.files import read_job
from armcontour.files.set_point_reader import read_set_points
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
        execute(run, Run(job=self.file, out=self.first, simulate=False))
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


def test_learn_continues_from_the_set_points_of_an_earlier_result(
    command, shop, tmp_path, refused, done
):
    log = written(tmp_path, shop.table)
    out = tmp_path / "second"
    third = tmp_path / "third"
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

    # The file of set-points is sufficient to find the lesson in its folder.
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
        (
            (second, "--set-points", shop.first, "--out", "a"),
            ["run2.csv is the log of another run"],
        ),
    ]
    assert refused(tmp_path, rows, codes=(2,), begin=learn) == []


def test_several_logs_of_the_same_set_points_are_compared(shop, tmp_path, done):
    logs = []
    for k, bump in enumerate((0.0, 0.0, 0.0, 0.5)):
        table = shop.executed(shop.first, k)
        table[:, 3:] += bump * np.sin(np.linspace(0.0, np.pi, len(table)))[:, None] ** 2
        logs += ["--log", written(tmp_path, table, name=f"run{k + 1}.csv")]
    out = tmp_path / "out"
    shown = done("learn", shop.file, *logs, "--set-points", shop.first, "--out", out)
    assert "Run 4 differs from runs 1 to 3" in shown
    data = summary(out)["learning"]
    assert data["different_runs"] == [4] and len(data["runs"]) == 4
    assert data["largest_of_runs"] == pytest.approx(max(x["contour_max"] for x in data["runs"]))


def test_options_that_exclude_each_other_are_refused(shop, tmp_path, refused):
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
