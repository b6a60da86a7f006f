"""Single corners with a tolerance of their own."""

import dataclasses

import numpy as np
import pytest
from tests.geometry.tables import refused

import armcontour as ac
from armcontour.geometry import Path
from armcontour.io import parse_job
from armcontour.jobs import programs_of
from armcontour.jobs.single_corners import corner_waypoints
from armcontour.program import Lead, Process, Program, prepare

OPEN = "[[0.3, 0.2], [0.36, 0.2], [0.36, 0.26], [0.36, 0.27], [0.3, 0.26]]"
SQUARE = "[[0.3, 0.2], [0.36, 0.2], [0.36, 0.26], [0.3, 0.26], [0.3, 0.2]]"
JOB = """\
name: corners
arm: pmk3s
path: {{points: {points}}}
{process}
limits: {{speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}}
corners: {corners}
servo: {{kp: 25 1/s, kv: 150 1/s}}
runs: {{only: {{compensation: {{method: none}}}}}}
"""


def job(corners, points=OPEN, process=""):
    corners = corners if "{" in corners else f"{{tolerance: 1 mm, at: {{{corners}}}}}"
    return parse_job(JOB.format(points=points, process=process, corners=corners))


def errors(of):
    """The corners of the rounded path [mm], and their errors [mm]."""
    _, program = programs_of(of, of.runs[0])
    corners = program.contours[0].path.corners
    return np.column_stack([corners.point, corners.error]) * 1e3


def test_one_corner_has_its_own_error_and_the_others_have_the_error_of_all():
    # Waypoint 4 is a corner, waypoint 3 is in a line.
    lead = "process: {lead_in: {length: auto, shape: line, side: left}}"
    begin = "process: {begin: 0.02, overlap: 90 mm}"
    # The overlap passes waypoints 2 and 3 once more.
    overlapping = [(360, 200, 0.2), (360, 260, 1), (300, 260, 1), (300, 200, 0.1), (360, 200, 0.2)]
    for found, expected in (
        (job("2: 0.2 mm"), [(360, 200, 0.2), (360, 270, 1.0)]),
        (job("2: 3 mm, 4: 0 mm"), [(360, 200, 3.0), (360, 270, 0.0)]),
        (job("2: 0.2 mm", OPEN, lead), [(360, 200, 0.2), (360, 270, 1.0)]),
        (job("1: 0.1 mm, 2: 0.2 mm", SQUARE, begin), overlapping),
    ):
        np.testing.assert_allclose(errors(found), expected, atol=1e-6)


def test_corners_are_found_between_leads_and_in_reverse():
    path = Path.polyline([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]])
    lead = Lead(length=5e-3, shape="line", side="left")
    process = Process(lead_in=lead, lead_out=lead)
    (contour,) = prepare(Program.of(path), process).contours
    assert len(contour.path) == 5
    assert corner_waypoints(path, contour.path).tolist() == [0, 2, 3, 0]
    back = Path.polyline(path.vertices[::-1])
    assert corner_waypoints(path, back).tolist() == [3, 2]


def test_corners_are_found_by_places_and_directions():
    # A path that comes back to its second point from below.
    points = [[0, 0], [0.1, 0], [0.1, 0.1], [0.2, 0.1], [0.2, -0.1], [0.1, 0], [0.1, -0.2]]
    path = Path.polyline(points)
    assert corner_waypoints(path, path).tolist() == [2, 3, 4, 5, 6]
    # Seen from a path that starts later, where only places and directions tell.
    later = Path.polyline([[0.05, 0], *points[1:]])
    assert corner_waypoints(path, later).tolist() == [2, 3, 4, 5, 6]
    repeated = Path.polyline([[0, 0], [0, 0], [0.1, 0], [0.1, 0.1]])
    assert corner_waypoints(repeated, repeated).tolist() == [3]
    longer = Path.polyline([[-0.1, 0], [0, 0], [0.1, 0], [0.1, 0.1]])
    assert corner_waypoints(repeated, longer).tolist() == [0, 3]
    straight = Path.polyline([[0, 0], [0.1, 0], [0.2, 0]])
    assert not corner_waypoints(straight, straight).any()
    assert not corner_waypoints(straight, longer).any()
    spline = Path.spline([[0, 0], [0.1, 0.02], [0.2, 0]], tolerance=1e-5)
    assert not corner_waypoints(spline, spline).any()


def test_what_is_no_corner_is_refused():
    one, drawn = job("2: 1 mm"), job("1: 0.1 mm", SQUARE, "process: {begin: drawn}")
    moves = Program.of(Path.polyline([[0.3, 0.2], [0.36, 0.2], [0.36, 0.26]])).moves
    two = Program(moves=(*moves, ac.Rapid(), *moves))
    refused(
        (lambda: job("1: 1 mm"), "waypoint 1 is an end of the path"),
        (lambda: job("9: 1 mm"), "no waypoint 9: the path has 5"),
        (lambda: job("3: 1 mm"), "no corner at waypoint 3"),
        (lambda: job("5: 1 mm", SQUARE), "waypoint 5 is the start", "name it 1"),
        (lambda: job("2: 1 mm", SQUARE, "process: {kerf: 1 mm}"), "without process.k"),
        (lambda: job("{shape: free, tolerance: 1 mm, at: {2: 1 mm}}"), "at is for corners"),
        (lambda: job("{speed: 0.1, acceleration: 1, at: {2: 1 mm}}"), "at needs corners.tolerance"),
        (lambda: job("2: -1 mm"), "corners.at.2: must not be negative"),
        (lambda: programs_of(drawn, drawn.runs[0]), "starts and ends at waypoint 1"),
        (lambda: dataclasses.replace(one, path=two), "path of one contour, but the job has 2"),
    )
    # The automatic start is in the middle of a segment: something passes waypoint 1.
    passing = errors(job("1: 0.1 mm", SQUARE, "process: {}"))
    assert (np.abs(passing - (300, 200, 0.1)).max(axis=1) < 1e-6).any()


def test_runs_that_differ_in_one_corner_are_different():
    one, other = job("2: 1 mm").runs[0].rounding, job("2: 2 mm").runs[0].rounding
    assert len({one, other}) == 2
    within = other.within(5e-4)
    assert (within.tolerance, within.at) == (5e-4, {2: 5e-4})
    assert one.within(2.0).at[2] == pytest.approx(1e-3)
