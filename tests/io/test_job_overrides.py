"""Values in the place of a job's own, such as those of a command line."""

import numpy as np
import pytest
import yaml
from tests.io.tables import refusals, values

from armcontour.io import parse_job
from armcontour.io.cell import read_cell
from armcontour.io.job_overrides import JobOverrides
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


def read(text, changes="{}"):
    """The runs of the job, with values in the place of its own and with changes of it."""
    x = JobOverrides(**yaml.safe_load(text))
    job = parse_job(yaml.safe_dump({**JOB, **yaml.safe_load(changes)}), overrides=x)
    return {run.name: run for run in job.runs}


# A tolerance rounds no corner that a run has sharp, but those of a job that has them so.
VALUES = """
{} => {own.limits.speed: 0.01, own.rounding.tolerance: 0.001, plain.limits.speed: 0.1}
{} => {sharp.rounding: null, lifted.limits.speed: null, slow.rounding.speed: 0.03}
{speed: 0.05} => {plain.limits.speed: 0.05, own.limits.speed: 0.05, lifted.limits.speed: 0.05}
{speed: 0.05} => {own.limits.joint_velocity: [1, 1], plain.limits.joint_velocity: [2, 2]}
{speed: 0.05} => {own.rounding.tolerance: 0.001, sharp.limits.speed: 0.05, slow.limits.speed: 0.05}
{corner_tolerance: 0.0002} => {plain.rounding.tolerance: 0.0002, own.rounding.tolerance: 0.0002}
{corner_tolerance: 0.0002} => {sharp.rounding: null, lifted.rounding.tolerance: 0.0002}
{corner_tolerance: 0.0002} => {slow.rounding.tolerance: null, slow.rounding.speed: 0.03}
{corner_tolerance: 0.0002} => {plain.rounding.angular_tolerance: 0.017453292519943295}
"""


def test_values_go_before_those_of_the_job_and_of_its_runs():
    values(read, VALUES)
    found = read("{corner_tolerance: 0.0002}", "corners: sharp")
    assert found["plain"].rounding.tolerance == 2e-4
    job = parse_job(yaml.safe_dump(JOB), overrides=JobOverrides(from_s=0.01))
    assert prepare(job.program, job.process).length == pytest.approx(0.06)


def test_a_shape_goes_to_every_run_that_can_have_it():
    of_job = {**JOB["runs"], "paper": {"timing": {"method": "mac"}}}
    del of_job["slow"]
    of_job = yaml.safe_dump({"runs": of_job}, default_flow_style=True)
    found = read("{corner_shape: free, line_tolerance: 0.0001, zone: 0.01, iterations: 4}", of_job)
    free = {"shape": "free", "line_tolerance": 1e-4, "zone": 0.01, "iterations": 4}
    assert found["own"].rounding == Rounding(tolerance=1e-3, **free)
    angle = pytest.approx(np.radians(1))
    assert found["plain"].rounding.angular_tolerance == angle
    assert found["plain"].rounding.free and found["plain"].rounding.tolerance == 2e-3
    assert found["sharp"].rounding is None
    assert not found["paper"].rounding.free and found["paper"].rounding.zone is None
    # Without corners of the job there are those of --tolerance.
    sharp = yaml.safe_dump({**yaml.safe_load(of_job), "corners": "sharp"})
    found = read("{corner_shape: free, corner_tolerance: 0.0003}", sharp)
    assert found["plain"].rounding == Rounding(shape="free", tolerance=3e-4)
    # A free shape becomes arcs again, and has no corners with a tangent or a curvature.
    free = (
        "runs: {one: {corners: {shape: free, tolerance: 1 mm, line_tolerance: 0.1 mm, zone: 9 mm}}}"
    )
    assert read("{corner_shape: arc}", free)["one"].rounding == Rounding(tolerance=1e-3)
    same = read("{corner_shape: free}", free)["one"].rounding
    assert same.free and same.zone == pytest.approx(9e-3)
    curved = "{corners: {tolerance: 1 mm, continuity: curvature}, runs: {one: {}}}"
    found = read("{corner_shape: free}", curved)["one"].rounding
    assert found == Rounding(shape="free", tolerance=1e-3)


BAD = """
{corner_shape: round} => --corner-shape must be one of arc, free, not 'round'
{corner_shape: free} => runs.slow.corners.speed sets the radius of arcs
{zone: 0.01} => runs.lifted.corners.zone is for the shape free
"""
OF_NO_RUN = """
{corner_shape: free} => No run has both rounded corners and the timing
{continuity: G2} => --continuity must be one of tangent, curvature, not 'G2'
{continuity: curvature} => No run has both corners rounded with arcs
"""


def test_values_that_do_not_fit_are_refused():
    refusals(read, BAD)
    refusals(lambda x: read(x, "{corners: sharp, runs: {one: {}}}"), OF_NO_RUN)


def test_a_continuity_goes_to_every_run_that_can_have_it():
    of_job = """
runs:
  plain: {}
  paper: {timing: {method: mac}}
  free: {corners: {shape: free, tolerance: 1 mm}}
  sharp: {corners: sharp}
"""
    found = {name: x.continuity for name, x in read("{continuity: curvature}", of_job).items()}
    assert found == {"plain": "curvature", "paper": "tangent", "free": None, "sharp": None}


def test_a_drawing_is_placed_and_its_layers_keep_what_the_job_says_of_them(tmp_path):
    (tmp_path / "part.csv").write_text("x,y,layer\n0,0,a\n40,0,a\n0,9,b\n40,9,b\n")
    own = {"frame": {"position": [0.3, 0.2, 0]}, "layers": {"a": {"speed": 0.02}, "b": {}}}
    cell = {**JOB, "path": {**own, "units": "mm"}}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(cell))

    def placed(**changes):
        x = JobOverrides(layers=("a",), **changes)
        job = read_cell(tmp_path / "cell.yaml", tmp_path / "part.csv", overrides=x)
        return prepare(job.program, job.process).path

    np.testing.assert_allclose(placed().vertices, [[0.3, 0.2], [0.34, 0.2]])
    assert placed().speeds.tolist() == [0.02]
    turned = placed(turn=(0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(turned.vertices, [[0.3, 0.2], [0.3, 0.24]], atol=1e-15)
    moved = placed(position=(0.28, 0.25, 0.0), scale=0.5)
    np.testing.assert_allclose(moved.vertices, [[0.28, 0.25], [0.3, 0.25]], atol=1e-15)
    words = "units must be a unit of length such as mm, not 'kg'"
    table = [({"scale": 0.0}, "scale must be above zero, but is 0"), ({"units": "kg"}, words)]
    refusals(lambda x: placed(**x), table)
