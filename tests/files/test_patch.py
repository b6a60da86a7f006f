"""Patches of job files: which value each run gets."""

import numpy as np
import pytest
import yaml
from tests.files.tables import refusals, values

import armcontour as ac
from armcontour.core.yaml_loader import load
from armcontour.files import parse_job, parse_set, read_job
from armcontour.files.job_file import read_cell
from armcontour.files.job_patch import key_of, locate_key, resolve_patch, write_patch
from armcontour.files.job_text_edits import REMOVE, change_data
from armcontour.jobs import Rounding
from armcontour.program import prepare

JOB = yaml.safe_load("""
name: plane
arm: pmk3s
path: {points: [[0.30, 0.20], [0.34, 0.20], [0.34, 0.23]]}
limits: {speed: 100 mm/s, joint_velocity: 2.0, centripetal_acceleration: 0.09}
corners: {tolerance: 2 mm, angular_tolerance: 1 deg}
servo: {kp: 25, kv: 150}
runs:
  plain: {}
  sharp: {corners: sharp}
  own: {limits: {speed: 10 mm/s, joint_velocity: 1.0}, corners: {tolerance: 1 mm}}
  lifted: {limits: {speed: inf}}
  slow: {corners: {speed: 30 mm/s, acceleration: 0.05 m/s^2}}
""")


def patch(text):
    """A patch from a mapping of keys with dots."""
    return {key_of(key): value for key, value in yaml.safe_load(text).items()}


def read(text, changes="{}"):
    """The runs of the job, with values in the place of its own and with changes of it."""
    changed = yaml.safe_dump({**JOB, **yaml.safe_load(changes)})
    job = parse_job(changed, patch=patch(text))
    # The file with these values is the same job.
    again = parse_job(write_patch(changed, patch(text)))
    assert [(x.rounding, x.timing, x.cycle) for x in again.runs] == [
        (x.rounding, x.timing, x.cycle) for x in job.runs
    ]
    return {run.name: run for run in job.runs}


# A tolerance rounds no corner that a run has sharp, but those of a job that has them so.
VALUES = """
{} => {own.limits.speed: 0.01, own.rounding.tolerance: 0.001, plain.limits.speed: 0.1}
{} => {sharp.rounding: null, lifted.limits.speed: null, slow.rounding.speed: 0.03}
{limits.speed: 0.05} => {plain.limits.speed: 0.05, own.limits.speed: 0.05}
{limits.speed: 0.05} => {lifted.limits.speed: 0.05, slow.limits.speed: 0.05}
{limits.speed: 0.05} => {own.limits.joint_velocity: [1, 1], plain.limits.joint_velocity: [2, 2]}
{limits.speed: 0.05} => {own.rounding.tolerance: 0.001, sharp.limits.speed: 0.05}
{corners.tolerance: 0.0002} => {plain.rounding.tolerance: 0.0002, own.rounding.tolerance: 0.0002}
{corners.tolerance: 0.0002} => {sharp.rounding: null, lifted.rounding.tolerance: 0.0002}
{corners.tolerance: 0.0002} => {slow.rounding.tolerance: null, slow.rounding.speed: 0.03}
{corners.tolerance: 0.0002} => {plain.rounding.angular_tolerance: 0.017453292519943295}
"""


def test_options_replace_values_of_the_job_and_of_its_runs():
    values(read, VALUES)
    runs = read("{corners.tolerance: 0.0002}", "corners: sharp")
    assert runs["plain"].rounding.tolerance == 2e-4
    job = parse_job(yaml.safe_dump(JOB), patch=parse_set("process.resume_at=1 cm"))
    assert prepare(job.program, job.process).length == pytest.approx(0.06)


FREE = "{corners.shape: free}"


def test_a_free_shape_applies_to_every_run_that_supports_it():
    of_job = {**JOB["runs"], "paper": {"timing": {"method": "paper"}}}
    del of_job["slow"]
    of_job = yaml.safe_dump({"runs": of_job}, default_flow_style=True)
    runs = read(FREE, of_job)
    assert runs["own"].rounding == Rounding(shape="free", tolerance=1e-3)
    angle = pytest.approx(np.radians(1))
    assert runs["plain"].rounding.angular_tolerance == angle
    assert runs["plain"].rounding.free and runs["plain"].rounding.tolerance == 2e-3
    assert runs["sharp"].rounding is None
    assert not runs["paper"].rounding.free
    # Without corners of the job there are those of --tolerance.
    sharp = yaml.safe_dump({**yaml.safe_load(of_job), "corners": "sharp"})
    runs = read("{corners.shape: free, corners.tolerance: 0.0003}", sharp)
    assert runs["plain"].rounding == Rounding(shape="free", tolerance=3e-4)
    # A free shape becomes arcs again, and has no corners with a tangent or a curvature.
    free = "runs: {one: {corners: {shape: free, tolerance: 1 mm}}}"
    assert read("{corners.shape: arc}", free)["one"].rounding == Rounding(tolerance=1e-3)
    curved = "{corners: {tolerance: 1 mm, continuity: curvature}, runs: {one: {}}}"
    runs = read("{corners.shape: free}", curved)["one"].rounding
    assert runs == Rounding(shape="free", tolerance=1e-3)


BAD = """
{corners.shape: round} => corners.shape: must be one of arc, free, not 'round'
{corners.shape: free} => runs.slow.corners.speed determines the radius of arcs
{limits.speed: 1 mm} => limits.speed: must be a quantity in m/s
{limits.sped: 1} => unknown key limits.sped: did you mean speed?
{tolerance: 1 mm} => unknown key tolerance: did you mean certificate.tolerance or corners.tolerance?
{runs.onw.duration: 1} => runs.onw.duration names no run of the job: did you mean own?
{runs: {}} => runs names no run of the job
{limits.joint_velocity.1: 1} => limits.joint_velocity is 2.0, which has no key 1
{path.points.9.0: 1} => path.points (item 10, item 1) cannot be changed ... list has only 3 items.
"""
OF_NO_RUN = """
{corners.shape: free} => corners.shape requires a run with rounded corners
{corners.continuity: curvature} => corners.continuity requires a run
"""


def test_values_that_do_not_fit_are_refused():
    refusals(read, BAD)
    refusals(lambda x: read(x, "{corners: sharp, runs: {one: {}}}"), OF_NO_RUN)


def test_options_place_a_drawing_and_keep_the_settings_of_its_layers(tmp_path):
    (tmp_path / "part.csv").write_text("x,y,layer\n0,0,a\n40,0,a\n0,9,b\n40,9,b\n")
    path_keys = {"frame": {"position": [0.3, 0.2, 0]}, "layers": {"a": {"speed": 0.02}, "b": {}}}
    cell = {**JOB, "path": {**path_keys, "units": "mm"}}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(cell))

    def placed(text="{}"):
        of_part = {("path", "layers"): ["a"], **patch(text)}
        job = read_cell(tmp_path / "cell.yaml", tmp_path / "part.csv", patch=of_part)
        return prepare(job.program, job.process).path

    np.testing.assert_allclose(placed().vertices, [[0.3, 0.2], [0.34, 0.2]])
    assert placed().speeds.tolist() == [0.02]
    turned = placed("{path.frame.rpy: [0, 0, 90 deg]}")
    np.testing.assert_allclose(turned.vertices, [[0.3, 0.2], [0.3, 0.24]], atol=1e-15)
    moved = placed("{path.frame.position: [0.28, 0.25, 0], path.scale: 0.5}")
    np.testing.assert_allclose(moved.vertices, [[0.28, 0.25], [0.3, 0.25]], atol=1e-15)
    words = "units must be a unit of length such as mm, but is 'kg'"
    table = [("{path.scale: 0}", "path.scale: "), ("{path.units: kg}", words)]
    refusals(placed, table)


def test_a_text_sets_a_key_to_a_value_of_a_job_file():
    for text, expected in (
        ("corners.tolerance=0.2 mm", {("corners", "tolerance"): "0.2 mm"}),
        (" limits.speed = 0.2", {("limits", "speed"): 0.2}),
        ("path.columns=x [mm],y [mm],-", {("path", "columns"): "x [mm],y [mm],-"}),
        ("experiment=", {("experiment",): None}),
        ("runs.a.corners={tolerance: 1 mm}", {("runs", "a", "corners"): {"tolerance": "1 mm"}}),
        ("path.frame.position=[1, 2, 3]", {("path", "frame", "position"): [1, 2, 3]}),
    ):
        assert parse_set(text) == expected
    table = [("units", "such as limits.speed=0.2 m/s"), ("a..b=1", "'a..b' is not a key")]
    refusals(parse_set, [*table, ("a=[1", "a is not valid YAML")])


def test_a_value_is_set_in_the_run_that_has_its_key_or_else_in_the_job():
    for text, run, expected in (
        ("limits.speed", "own", "runs.own.limits.speed"),
        ("limits.speed", "plain", "limits.speed"),
        ("limits.centripetal_acceleration", "own", "limits.centripetal_acceleration"),
        # Corners of a run replace those of the job.
        ("corners.angular_tolerance", "own", "runs.own.corners.angular_tolerance"),
        ("corners.tolerance", "sharp", "runs.sharp.corners.tolerance"),
        ("cycle", "own", "cycle"),
        ("timing.reserve", "plain", "runs.plain.timing.reserve"),
        ("servo.kp", "own", "servo.kp"),
        ("runs.own.duration", "plain", "runs.own.duration"),
    ):
        assert ".".join(locate_key(key_of(text), JOB, run)) == expected
    assert locate_key(key_of("path.points.0.1"), JOB) == ("path", "points", 0, 1)
    changes = resolve_patch(JOB, patch("{limits.speed: 1, timing.reserve: 0.1}"), "own")
    new = change_data(JOB, changes)
    assert new["limits"] == JOB["limits"] and "timing" not in new["runs"]["plain"]
    assert new["runs"]["own"]["limits"]["speed"] == 1
    assert new["runs"]["own"]["timing"] == {"reserve": 0.1}
    assert "timing" not in JOB["runs"]["own"]


def test_keys_of_the_previous_choice_are_removed():
    job = "runs: {a: {timing: {method: paper, knots: 50, reserve: 0.1}}, b: {}}"
    runs = read("{timing.method: optimal}", job)
    assert [x.timing.method for x in runs.values()] == ["optimal"] * 2
    assert runs["a"].timing.reserve == 0.1
    # But keys that are specified together with it stay.
    words = "runs.a.timing ... knots requires the method paper, not optimal"
    both = "{timing.knots: 40, timing.method: optimal}"
    refusals(lambda x: read(x, job), [(both, words)])


def test_patch_expands_short_forms_to_mappings():
    text = "arm: pmk3s # mine\npath: {file: a.dxf, layers: [a, b]}\n"
    new = write_patch(text, patch("{path.layers.a.speed: 1 m/s, arm.work.position: [0, 0, 1]}"))
    assert load(new, "") == {
        "arm": {"name": "pmk3s", "work": {"position": [0, 0, 1]}},
        "path": {"file": "a.dxf", "layers": {"a": {"speed": "1 m/s"}, "b": {}}},
    }
    assert write_patch(new, {("arm",): REMOVE, ("path",): REMOVE}) == "{}\n"


CELL = {"arm": "ur5e", "servo": {"kp": 25, "kv": 150}, "runs": {"a": {}}}
POSITION = ("path", "frame", "position")


@pytest.mark.parametrize(("z", "height"), [(0.1, 0.1), ("120 mm", 0.12), (-0.05, -0.05)])
def test_part_moved_in_x_and_y_keeps_its_height(tmp_path, z, height):
    (tmp_path / "line.csv").write_text("x [mm],y [mm]\n0,0\n50,0\n")
    cell = tmp_path / "cell.yaml"
    cell.write_text(yaml.safe_dump({**CELL, "path": {"frame": {"position": [0.3, 0.1, z]}}}))
    for position in ([0.4, "-100 mm"], [0.4, "-100 mm", z], ["400 mm", -0.1, z]):
        job = read_job(tmp_path / "line.csv", cell=cell, patch={POSITION: position})
        start = job.program.contours[0].path(0.0)
        np.testing.assert_allclose(start, [0.4, -0.1, height], atol=1e-12)
        np.testing.assert_allclose(job.part.position, start, atol=1e-12)


def test_x_and_y_of_a_part_without_a_z_are_refused(tmp_path):
    (tmp_path / "line.csv").write_text("x [mm],y [mm]\n0,0\n50,0\n")
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(CELL))

    def read_at(patch):
        return read_job(tmp_path / "line.csv", cell=tmp_path / "cell.yaml", patch=patch)

    words = "path.frame.position requires x, y and z"
    refusals(read_at, [({POSITION: ["400 mm", 0]}, words)])
    with pytest.raises(ac.InvalidInput) as error:
        read_at({POSITION[:2]: {"position": [0.4, 0]}})
    assert error.value.key == POSITION
    assert read_at({POSITION: [0.4, 0, 0.1]}).part.position[2] == 0.1
