"""Job files: the job that they describe, and refusals."""

import copy
from pathlib import Path as FilePath

import jsonschema
import numpy as np
import yaml
from tests.files.tables import refusals, values

import armcontour as ac
from armcontour.cli.run_command import built_in_job
from armcontour.files import json_schema, parse_job, read_job
from armcontour.jobs import Rounding

ROOT = FilePath(__file__).parents[2]
GOOD = yaml.safe_load("""
name: bracket
arm: pmk3s
path: {points: [[300 mm, 0.20], [0.40, 0.20], [0.40, 0.30]]}
limits: {speed: 0.10 m/s, centripetal_acceleration: 0.09}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150}
runs: {one: {timing: {method: paper}}}
""")


def with_change(*changes):
    """The good job as text, with some keys changed; null removes an outer one."""
    data = copy.deepcopy(GOOD)
    for change in changes:
        place, _, value = change.partition(": ")
        *keys, last = place.split(".")
        inner = data
        for key in keys:
            inner = inner.setdefault(key, {})
        inner[last] = yaml.safe_load(value)
    return yaml.safe_dump({key: x for key, x in data.items() if x is not None})


def parse(changes):
    return parse_job(with_change(*changes.split(" | ")), source="bracket.yaml")


# Changes of the good job, and what is then where.
VALUES = """
title: x => {arm.name: PMK-3s, path.vertices: [[0.3, 0.2], [0.4, 0.2], [0.4, 0.3]]}
title: x => {runs.one.timing.method: paper, runs.one.cycle: 4.0e-3}
title: x => {runs.one.compensation.method: inverse}
title: x => {runs.one.limits.speed: 0.1, runs.one.rounding.tolerance: 2.0e-3, servo.kp: [25, 25]}
title: x => {runs.one.limits.joint_acceleration: [0.72, 0.72]}
runs.one: {limits: {speed: 40 mm/s}} => {runs.one.limits.speed: 0.04}
runs.one: {limits: {speed: 40 mm/s}} => {runs.one.limits.centripetal_acceleration: 0.09}
runs.one: {corners: sharp, end_time: 3 s} => {runs.one.rounding: null, runs.one.end_time: 3.0}
runs.one: {cycle: 1 ms} => {runs.one.cycle: 0.001}
limits: {joint_acceleration: inf} => {runs.one.limits.joint_acceleration: null}
limits: {joint_acceleration: null} => {runs.one.limits.joint_acceleration: [0.72, 0.72]}
limits: {joint_velocity: 2.0} => {runs.one.limits.joint_velocity: [2, 2]}
runs.two: {limits: {speed: .inf}} => {runs.two.limits.speed: null, runs.one.limits.speed: 0.1}
runs.two: {limits: {speed: null}} => {runs.two.limits.speed: 0.1}
runs.two: {limits: {joint_acceleration: inf}} => {runs.two.limits.joint_acceleration: null}
plant: {dead_time: 44 ms} => {plant_servo.kp: [25, 25], plant_servo.kv: [150, 150]}
plant: {dead_time: 44 ms} => {plant_servo.dead_time: [0.044, 0.044], servo.dead_time: [0, 0]}
plant: {order: first} => {plant_servo.order: first, plant_servo.kv: null}
plant: {} => {plant_servo.order: second}
experiment: {} => {runs.one.compensation.method: inverse_dynamics}
experiment: {} | runs.one.compensation: {} => {runs.one.compensation.method: inverse_dynamics}
experiment: {} | runs.one.compensation: {method: none} => {runs.one.compensation.method: none}
experiment: {} | servo: {kp: 25 1/s, order: first} => {runs.one.compensation.method: inverse}
corners: {speed: 0.03 m/s, acceleration: 0.05} => {runs.one.limits.centripetal_acceleration: 0.09}
limits: {} | corners: {speed: 1, acceleration: 1} => {runs.0.limits.centripetal_acceleration: 1}
"""


def test_valid_jobs_are_read_in_si_units():
    values(parse, VALUES)
    path = "path: {start: [0.28, 0.2], segments: [{to: [0.4, 0.2], speed: 50 mm/s}, %s]}"
    path_read = parse(path % "{center: [0.40, 0.23], angle: 180 deg}").path
    np.testing.assert_allclose(path_read.vertices[-1], [0.40, 0.26], atol=1e-15)
    assert path_read.speeds[0] == 0.05
    free = "shape: free, tolerance: 5 mm"
    run = parse(f"runs.one: {{corners: {{{free}}}}}").runs[0]
    assert run.timing == ac.Optimal() and run.rounding == Rounding(shape="free", tolerance=5e-3)
    # PyYAML would read a text.
    text = with_change("corners: {tolerance: X}").replace("X", "2e-3")
    assert parse_job(text).runs[0].rounding == Rounding(tolerance=2e-3)


BAD = r"""
arm: null => the key arm is missing
limits.speeed: 1 => unknown key limits.speeed: did you mean speed?
runs.one.timing.start_speed: 1 => start_speed: the known keys are method, reserve, knots
runs.one.servo: {kp: 50 1/s} => runs.one.servo: servo applies to the whole job,
corners: {tolerance: 0, 2 mm: null} => unknown key corners.2 mm: a comma ends
corners: {} => corners requires either tolerance ... or both speed and acceleration
corners.tolerance: -2 mm => corners.tolerance: must not be negative, but is -2 mm
runs.one.timing.method: shaped => timing.method: must be one of optimal, paper
runs.one.compensation: {method: full} => method: must be one of inverse, pole_placement
runs.one.compensation: {poles: [-1, -1]} => poles: must have at least 3 entries, but has 2
runs.one.compensation: {method: inverse, gravity_feedforward: false} => gravity_feedforward requires
runs.one.timing.knots: 1 => runs.one.timing.knots: must be a whole number from 8 to
limits.speed: "0.1" => limits.speed: '0.1' has no unit
limits.speed: 5 mm => limits.speed: must be a quantity in m/s
path.points: [[0.3, .nan], [0.3, 0.2]] => path.points (item 1, item 2): must be finite
path.points: [[0.3, 0.2], [0.3, 0.2, 0.1]] => all have 2 or all have 3
servo.order: first => remove its gain kv
runs: {../up: {}} => runs.../up: the name must
path: {points: [[0, 0], [0, 1e308 m]]} => path.points (item 2, item 2) ... 1e+12 m, but is 1e308 m
runs.one: {timing: {reserve: 10}} => runs.one.timing.reserve: ... but is 10. For ... write 10 %
"""


def test_invalid_jobs_are_refused_in_one_sentence():
    refusals(parse, BAD, "bracket.yaml: ")
    keys = ("a[b", "path(1", "name:j/[{kS", "float", "ArmModel")
    refusals(parse, [(f"{x}: 1", f"unknown key {x}: ") for x in keys])


def test_files_that_are_no_jobs_are_refused(tmp_path):
    tens = zip("abcdefgh", "bcdefghi", strict=True)
    flood = "".join(f"{y}: &{y} [{', '.join(['*' + x] * 10)}]\n" for x, y in tens)
    table = [
        ("{", "not valid YAML: ... line 2"),
        ("- 1", "must be a mapping"),
        ("", "must be a mapping"),
        ("name: a\nname: b", "'name' is repeated"),
        ("[" * 20000, "nested too deeply"),
        ("a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + flood, "fewer aliases"),
        ("a: 2024-99-99", ""),
    ]
    refusals(parse_job, table)
    refusals(read_job, [(tmp_path / "none.yaml", "There is no job file")])


def test_an_arm_file_is_found_next_to_the_job(tmp_path):
    arm = (ROOT / "src/armcontour/files/robots/library/pmk3s.yaml").read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(arm.replace("PMK-3s", "mine"), encoding="utf-8")
    (tmp_path / "job.yaml").write_text(with_change("arm: mine.yaml"), encoding="utf-8")
    assert read_job(tmp_path / "job.yaml").arm.name == "mine"


def test_the_schema_accepts_valid_jobs_and_refuses_unknown_keys():
    jsonschema.Draft202012Validator.check_schema(json_schema())
    validator = jsonschema.Draft202012Validator(json_schema())
    text = (ROOT / "src/armcontour/jobs/library/paper.yaml").read_text(encoding="utf-8")
    assert list(validator.iter_errors(yaml.safe_load(text))) == []
    assert list(validator.iter_errors(GOOD)) == []
    assert list(validator.iter_errors({**GOOD, "speeed": 1}))


def test_the_built_in_job_is_that_of_the_paper():
    job = built_in_job()
    names = ["conventional", "uncompensated", "proposed", "optimal", "inverse-dynamics", "shaped"]
    assert [x.name for x in job.runs] == names
