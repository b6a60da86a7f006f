"""Cells as integrators build them are planned, and judged by kinematics of the tests' own.

The arrangement of axes, their ranges and speeds follow public descriptions of such machines; the
files are written for these tests.
"""

import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.cells import paths
from tests.cells.judging import judge
from tests.cells.own_kinematics import from_rpy, number, numbers

HERE = Path(paths.__file__).parent
TURN = 2 * np.pi
# Largest share of the time at the assigned speed that a plan may need in addition. The reserve of
# 10 % and the slow corners are included.
SLOWER = 0.25
# Shares of limits by differences of samples may exceed 1 by this.
ROUNDING = 1e-4


@dataclass(frozen=True)
class Expected:
    """What a good plan of a cell does."""

    travel: dict = field(default_factory=dict)  # largest way of joints [rad, m]
    slower: float = SLOWER


CELLS = {
    # The plate turns once.
    "irb4600_irbp_a": Expected(travel={"turn": TURN + 0.1, "tilt": 0.6}),
    "kr120_rail": Expected(),
    "m10ia_headstock": Expected(travel={"head": TURN + 0.1}),
    # The cone turns four times and stays inclined.
    "ma2010_mt1": Expected(travel={"turn": 4 * TURN + 0.4, "tilt": 0.8}),
    "ur10e_rail": Expected(),
    # The column is slower than the bead; the arm does most of the motion.
    "ur10e_lift": Expected(),
    "gantry_kr16": Expected(),
    "plasma_ca": Expected(),
    "waterjet_ab": Expected(),
    # The table turns by 90 degrees from rest to rest within each corner.
    "trunnion_ac": Expected(travel={"c": TURN + 0.01}, slower=1.2),
    "head_table_bc": Expected(travel={"c": 6 * TURN + 0.1}),
    "scara": Expected(),
    "palletiser": Expected(slower=0.4),
    "kr16_table": Expected(),
    "kr16_two_stations": Expected(travel={"station": 0.0, "head": TURN + 0.1}),
}


def put(name, folder):
    """Write a job with its files into a folder; return its file, its points and tool axes."""
    job = yaml.safe_load((HERE / f"{name}.yaml").read_text(encoding="utf-8"))
    shutil.copy(HERE / f"{name}.yaml", folder)
    if "file" in job["arm"]:
        shutil.copy(HERE / job["arm"]["file"], folder)
    if "file" in job["path"]:
        stem = Path(job["path"]["file"]).stem
        points, axes = getattr(paths, stem)()
        paths.write(folder / f"{stem}.csv", points, axes)
        return folder / f"{name}.yaml", points, axes
    points = np.array([numbers(x) for x in job["path"]["points"]])
    orientation = job["path"]["orientation"]
    if "axis" in orientation:
        axis = numbers(orientation["axis"])
    else:
        axis = from_rpy(*numbers(orientation["rpy"]))[:, 2]
    return folder / f"{name}.yaml", points, np.tile(axis / np.linalg.norm(axis), (len(points), 1))


# Cells with other tilts [deg], and with joints that are held [rad].
CHANGED = [
    *(("ma2010_mt1", {"tilt": f"{x} deg"}, {}) for x in (3, 8, 12, 25)),
    ("ma2010_mt1", {}, {"tilt": {"hold": 1.022}}),
    ("irb4600_irbp_a", {}, {"joint_1": {"hold": 0.0}}),
    ("irb4600_irbp_a", {}, {"tilt": {"hold": -0.78}}),
    ("m10ia_headstock", {}, {"j2": {"hold": 1.63}}),
]


def check(job_file, points, axes, expected, command):
    """Plan a job and judge the plan."""
    out = job_file.parent / "out"
    ended = command("run", job_file, "--no-simulation", "--no-changes", "--out", out)
    assert ended.code == 0, ended.errors
    figures = judge(job_file, out / "seam" / "planned.csv", points, axes)

    job = yaml.safe_load(job_file.read_text(encoding="utf-8"))
    tolerance = number(job["corners"]["tolerance"])
    assert figures.off_path <= tolerance + 1e-6
    assert figures.missed <= tolerance + 2e-5  # samples are a fraction of a millimetre apart
    assert figures.on_lines <= 1e-8  # the table has 12 decimals
    turned = number(job["corners"].get("angular_tolerance", 0.0))
    assert figures.off_axis <= turned + 2e-3  # a head near its pole may lean by 0.1 degrees
    speed = number(job["limits"]["speed"])
    assert figures.speed <= speed * (1 + ROUNDING)
    assert figures.range_margin >= -1e-9
    assert figures.velocity <= 1 + ROUNDING
    assert figures.acceleration <= 1 + ROUNDING
    arm = job["arm"]
    tilt = arm.get("tilt", arm.get("positioner", {}).get("tilt"))
    if tilt is not None:
        assert figures.from_gravity <= number(tilt) + 1e-6
    length = np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1))
    assert figures.duration <= (1 + expected.slower) * length / speed
    for joint, most in expected.travel.items():
        assert figures.travel[joint] <= most + 1e-9


@pytest.mark.parametrize("name", CELLS)
def test_cell_is_planned_within_its_limits(name, tmp_path, command):
    check(*put(name, tmp_path), CELLS[name], command)


@pytest.mark.parametrize(("name", "positioner", "preferences"), CHANGED)
def test_other_tilts_and_held_joints_are_planned(name, positioner, preferences, tmp_path, command):
    job_file, points, axes = put(name, tmp_path)
    job = yaml.safe_load(job_file.read_text(encoding="utf-8"))
    if positioner:
        job["arm"]["positioner"] |= positioner
    if preferences:
        job["arm"]["preferences"] = preferences
    job_file.write_text(yaml.safe_dump(job, sort_keys=False), encoding="utf-8")
    held = dict.fromkeys(preferences, 0.0)
    check(job_file, points, axes, Expected(travel=held), command)
