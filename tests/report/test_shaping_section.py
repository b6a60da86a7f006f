"""The section on shaped paths: its table has the outcome and the largest distance."""

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour.geometry import Outcome, Path, ShapedPath, round_corners
from armcontour.geometry.fit import draw_with_arcs
from armcontour.io import parse_job
from armcontour.jobs import Study, run
from armcontour.program import Contour, Program, put_on_path
from armcontour.report import render_report, sections
from armcontour.report.sections.corners import replaced_paths

TOLERANCE, WAVE = 5e-3, 0.3
PLANE = """
name: paper
arm: pmk3s
path: {points: [[0.350, 0.100], [0.410, 0.150], [0.280, 0.300], [0.350, 0.350]]}
limits: {speed: 0.15, centripetal_acceleration: 0.09}
corners: {tolerance: 5 mm}
servo: {kp: 25, kv: 150}
runs: {one: {}}
"""


def shaped_by_hand(objective, tolerance):
    """A path within the tolerance of an objective path: arcs at corners, waves along lines."""
    arcs = round_corners(objective, tolerance=0.6 * tolerance, angular_tolerance=0.01)
    s = np.linspace(0.0, objective.length, 150)
    at = arcs.place(s)
    along = arcs(at, 1)
    side = np.zeros_like(along)
    side[:, 0], side[:, 1] = -along[:, 1], along[:, 0]
    wave = WAVE * tolerance * np.sin(np.pi * s / objective.length * 6)
    # Shaped paths consist of arcs.
    path, _ = draw_with_arcs(Path.spline(arcs(at) + wave[:, None] * side), 1e-6)
    if objective.orientation is not None:
        path = path.oriented(objective.orientation(0.0))
    back = path.project(arcs(at) + wave[:, None] * side).s
    places = np.stack([s, np.maximum.accumulate(back)], axis=1)
    places[[0, -1], 1] = 0.0, path.length
    durations = {"arcs": 5.0, "stops": 5.1, "shaped": 4.5}
    outcome = Outcome(start="arcs", durations=durations, history=(4.9, 4.6, 4.5))
    return ShapedPath(
        segments=path.segments, orientation=path.orientation, objective=objective, places=places,
        tolerance=tolerance, outcome=outcome,
    )  # fmt: skip


def study_of_shaped(job, tolerance):
    """The study of a job whose contours were shaped by hand."""
    shaped = [
        put_on_path(x, shaped_by_hand(x.path, tolerance)) if isinstance(x, Contour) else x
        for x in job.program.moves
    ]
    runs = tuple(dataclasses.replace(x, rounding=None, timing="optimal") for x in job.runs)
    done = run(dataclasses.replace(job, path=Program(moves=tuple(shaped)), runs=runs)).runs
    own = {name: dataclasses.replace(x, objective=job.program) for name, x in done.items()}
    return Study(job=job, runs=own)


@pytest.fixture(scope="module")
def study():
    return study_of_shaped(parse_job(PLANE), TOLERANCE)


def shaped_path(study):
    path = study.runs["one"].path.path
    assert isinstance(path, ShapedPath)
    return path


def test_the_section_is_there_for_shaped_paths_only(study, in_order):
    rounded = run(parse_job(PLANE))
    assert sections.shaping(rounded) is None
    assert replaced_paths(rounded) == "the rounded path"
    page = render_report(study)
    in_order(page, "overview paths shaping joint-space speed")


def test_the_table_has_the_outcome_and_the_largest_distances(study):
    path = shaped_path(study)
    (table,) = sections.shaping(study).tables
    (row,) = table.rows
    found = dict(zip(table.header, row, strict=True))
    expected = {
        "arcs [s]": "5.000", "stops [s]": "5.100", "parabolas [s]": "", "shaped [s]": "4.500",
        "best start": "arcs", "gain": "10.00%", "iterations": "2",
    }  # fmt: skip
    assert {key: found[key] for key in expected} == expected
    dense = path(np.linspace(0, path.length, 20_000))
    nearest = path.objective.project(dense).distance.max()
    own = np.interp(np.linspace(0, path.length, 20_000), path.places[:, 1], path.places[:, 0])
    off = np.linalg.norm(dense - path.objective(own), axis=1).max()
    assert nearest <= off <= 1.2 * nearest
    assert float(found["distance [mm]"]) == pytest.approx(off * 1e3, rel=5e-3)


def test_a_path_that_stops_everywhere_has_a_note(study):
    result, path = study.runs["one"], shaped_path(study)
    still = ac.shape(path.objective, study.job.arm, result.run.limits, tolerance=0.0)
    (contour,) = result.path.contours
    program = dataclasses.replace(result.path, moves=(dataclasses.replace(contour, path=still),))
    stopped = dataclasses.replace(result, path=program)
    section = sections.shaping(Study(job=study.job, runs={"one": stopped}))
    assert section.tables[0].rows[0][-1] == "0.0000"
    assert section.notes == (f"run one: {still.outcome.note}.",)
