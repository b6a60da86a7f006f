"""Default values in pages and docstrings are those of the signatures."""

import dataclasses
import inspect
import re
from pathlib import Path

import pytest

import armcontour as ac
from armcontour.identification.identification import DRIVE_CYCLE, LONGEST_DELAY
from armcontour.io.job_model import TimingModel
from armcontour.jobs import PlaceSearch
from armcontour.scene.scene import MARGINS
from armcontour.timing.grid import DEFAULT_INTERVALS
from armcontour.timing.jerk.task import MOST_ITERATIONS
from armcontour.timing.shaping.wishes import DEFAULT_ITERATIONS

ROOT = Path(__file__).parents[1]
SCALES = {"": 1, "ms": 1e-3, "mm": 1e-3, "um": 1e-6, "kg": 1, "m": 1, "s": 1, "rad/s": 1, "%": 1e-2}


def default_of(call, name):
    return inspect.signature(call).parameters[name].default


def field(of, name):
    return next(x.default for x in dataclasses.fields(of) if x.name == name)


# A file, a pattern with the value and maybe its unit, and the value in use.
STATED = [
    ("docs/guides/identify.md", r"dead times up to this, (\S+) (ms)", LONGEST_DELAY),
    ("docs/guides/identify.md", r"keep a torque, (\S+) (ms) by default", DRIVE_CYCLE),
    (
        "docs/guides/gcode.md",
        r"tolerance \((\S+) (um) by default\)",
        default_of(ac.read_path, "chord_tolerance"),
    ),
    (
        "docs/guides/export.md",
        r"`derivatives` \| `(\d)` \(default\)",
        default_of(ac.export, "derivatives"),
    ),
    (
        "docs/guides/checking.md",
        r"`velocity_step`, (\S+) (rad/s) by",
        default_of(ac.check, "velocity_step"),
    ),
    ("docs/guides/checking.md", r"and at (\d+)\s+random places", default_of(ac.check, "points")),
    ("docs/concepts/clearance.md", r"`environment` \| (\S+) (mm)", MARGINS.environment),
    ("docs/concepts/clearance.md", r"`own` \| (\S+) (mm)", MARGINS.own),
    ("docs/concepts/clearance.md", r"`tool` \| (\S+) (mm)", MARGINS.tool),
    ("docs/tutorials/placement_and_clearance.md", r"by default (\S+) (mm), 2", MARGINS.environment),
    ("docs/guides/placement.md", r"`(\w+)` \(default\), `manip", field(PlaceSearch, "objective")),
    ("docs/concepts/certificate.md", r"`plant` \| `(\w+)` \(default\)", field(ac.Goal, "plant")),
    (
        "docs/concepts/certificate.md",
        r"`saturation` \| `(\w+)` \(default\)",
        field(ac.Goal, "saturation"),
    ),
    ("docs/concepts/programs.md", r"\| `(\w+)` \(default\) \| `inside", field(ac.Process, "order")),
    ("docs/concepts/optimal.md", r"The method `(\w+)` is the default", TimingModel().method),
    ("src/armcontour/timing/planner.py", r"by default (\d+), fewer", DEFAULT_INTERVALS),
    ("src/armcontour/timing/planner.py", r"by default (\d+) and \d+\.", MOST_ITERATIONS),
    ("src/armcontour/timing/planner.py", r"by default \d+ and (\d+)\.", DEFAULT_ITERATIONS),
]


@pytest.mark.parametrize(("file", "pattern", "used"), STATED, ids=[x[1] for x in STATED])
def test_a_stated_default_is_the_one_in_use(file, pattern, used):
    found = re.search(pattern, (ROOT / file).read_text(encoding="utf-8"))
    assert found is not None
    value, unit = (*found.groups(), "")[:2]
    if isinstance(used, str):
        assert value == used
    else:
        assert float(value) * SCALES[unit] == pytest.approx(used, rel=1e-9)


def test_defaults_of_compensation_are_those_of_its_page():
    page = (ROOT / "docs/guides/compensations.md").read_text(encoding="utf-8")
    bodies, others = re.findall(r"\| `(\w+)`, \*\*the default", page)
    arm, servo = ac.load_arm("pmk3s"), ac.ServoModel(kp=25.0, kv=150.0)
    plan = ac.plan(ac.JointPath.spline([(0.1, 1.0), (0.2, 1.1), (0.5, 1.0)]), arm)
    assert ac.compensate(plan, servo, arm=arm).method == bodies
    assert ac.compensate(plan, servo).method == others
    assert ac.compensate(plan, servo.replace(order="first", kv=None), arm=arm).method == others
