"""Single corners with a tolerance of their own."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.io import parse_job
from armcontour.jobs import Job, programs_of
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


def job(corners: str, points: str = OPEN, process: str = "") -> Job:
    return parse_job(JOB.format(points=points, process=process, corners=corners))


def errors(of: Job) -> list[tuple[list[float], float]]:
    """The corners of the rounded path, and their errors in mm."""
    _, program = programs_of(of, of.runs[0])
    (contour,) = program.contours
    corners = contour.path.corners
    return [
        (p.round(9).tolist(), 1e3 * e) for p, e in zip(corners.point, corners.error, strict=True)
    ]


def approximately(*found: tuple[list[float], float]) -> list:
    return [(point, pytest.approx(error, abs=1e-9)) for point, error in found]


def test_one_corner_has_its_own_error_and_the_others_have_the_error_of_all() -> None:
    # Waypoint 4 is a corner, waypoint 3 is in a line.
    assert errors(job("{tolerance: 1 mm, at: {2: 0.2 mm}}")) == approximately(
        ([0.36, 0.2], 0.2), ([0.36, 0.27], 1.0)
    )
    assert errors(job("{tolerance: 1 mm, at: {2: 3 mm, 4: 0 mm}}")) == approximately(
        ([0.36, 0.2], 3.0), ([0.36, 0.27], 0.0)
    )


def test_corners_keep_their_numbers_where_a_process_moves_the_start_and_runs_on() -> None:
    begin = "process: {begin: 0.02, overlap: 90 mm}"
    found = errors(job("{tolerance: 1 mm, at: {1: 0.1 mm, 2: 0.2 mm}}", SQUARE, begin))
    # The overlap passes waypoints 2 and 3 once more.
    assert found == approximately(
        ([0.36, 0.2], 0.2),
        ([0.36, 0.26], 1.0),
        ([0.3, 0.26], 1.0),
        ([0.3, 0.2], 0.1),
        ([0.36, 0.2], 0.2),
    )


def test_corners_are_found_between_leads_and_in_reverse() -> None:
    path = Path.polyline([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]])
    lead = Lead(length=5e-3, shape="line", side="left")
    process = Process(lead_in=lead, lead_out=lead)
    (contour,) = prepare(Program.of(path), process).contours
    assert len(contour.path) == 5
    assert corner_waypoints(path, contour.path).tolist() == [0, 2, 3, 0]
    back = Path.polyline(path.vertices[::-1])
    assert corner_waypoints(path, back).tolist() == [3, 2]


def test_two_corners_at_one_place_are_told_apart_by_their_directions() -> None:
    # A path that comes back to its second point from below.
    points = [[0, 0], [0.1, 0], [0.1, 0.1], [0.2, 0.1], [0.2, -0.1], [0.1, 0], [0.1, -0.2]]
    path = Path.polyline(points)
    assert corner_waypoints(path, path).tolist() == [2, 3, 4, 5, 6]


def test_merged_points_and_points_of_splines_count() -> None:
    repeated = Path.polyline([[0, 0], [0, 0], [0.1, 0], [0.1, 0.1]])
    assert corner_waypoints(repeated, repeated).tolist() == [3]
    spline = Path.spline([[0, 0], [0.1, 0.02], [0.2, 0]], tolerance=1e-5)
    assert not corner_waypoints(spline, spline).any()


@pytest.mark.parametrize(
    ("corners", "points", "process", "words"),
    [
        ("{tolerance: 1 mm, at: {1: 1 mm}}", OPEN, "", "waypoint 1 is an end of the path"),
        ("{tolerance: 1 mm, at: {9: 1 mm}}", OPEN, "", "no waypoint 9: the path has 5"),
        ("{tolerance: 1 mm, at: {3: 1 mm}}", OPEN, "", "no corner at waypoint 3"),
        ("{tolerance: 1 mm, at: {5: 1 mm}}", SQUARE, "", "waypoint 5 is the start .* name it 1"),
        ("{tolerance: 1 mm, at: {2: 1 mm}}", SQUARE, "process: {kerf: 1 mm}", "without process.k"),
        ("{shape: free, tolerance: 1 mm, at: {2: 1 mm}}", OPEN, "", "at is for corners with arcs"),
        ("{speed: 0.1, acceleration: 1, at: {2: 1 mm}}", OPEN, "", "at needs corners.tolerance"),
        ("{tolerance: 1 mm, at: {2: -1 mm}}", OPEN, "", r"corners\.at\.2: must not be negative"),
    ],
)
def test_what_is_no_corner_is_refused(corners, points, process, words) -> None:
    with pytest.raises(InvalidInput, match=words):
        job(corners, points, process)


def test_the_start_of_a_closed_path_is_a_corner_only_if_something_passes_it() -> None:
    at_start = "{tolerance: 1 mm, at: {1: 0.1 mm}}"
    with pytest.raises(InvalidInput, match="starts and ends at waypoint 1"):
        programs_of(of := job(at_start, SQUARE, "process: {begin: drawn}"), of.runs[0])
    # The automatic start is in the middle of a segment.
    assert ([0.3, 0.2], pytest.approx(0.1)) in errors(job(at_start, SQUARE, "process: {}"))


def test_a_program_of_several_contours_is_refused() -> None:
    path = Path.polyline([[0.3, 0.2], [0.36, 0.2], [0.36, 0.26]])
    two = Program(moves=(*Program.of(path).moves, ac.Rapid(), *Program.of(path).moves))
    one = job("{tolerance: 1 mm, at: {2: 1 mm}}")
    with pytest.raises(InvalidInput, match="path of one contour, but the job has 2"):
        Job(
            name="two",
            title="two",
            arm=one.arm,
            path=two,
            servo=one.servo,
            plant_servo=one.plant_servo,
            runs=one.runs,
        )


def test_automatic_leads_are_found_with_single_corners() -> None:
    lead = "{length: auto, shape: line, side: left}"
    of = job("{tolerance: 1 mm, at: {2: 0.2 mm}}", OPEN, f"process: {{lead_in: {lead}}}")
    found = dict((tuple(point), error) for point, error in errors(of))
    assert found[0.36, 0.2] == pytest.approx(0.2) and found[0.36, 0.27] == pytest.approx(1.0)


def test_runs_that_differ_in_one_corner_are_different() -> None:
    one, other = job("{tolerance: 1 mm, at: {2: 1 mm}}"), job("{tolerance: 1 mm, at: {2: 2 mm}}")
    pair = {one.runs[0].rounding, other.runs[0].rounding}
    assert len(pair) == 2
    within = other.runs[0].rounding.within(5e-4)
    assert (within.tolerance, within.at) == (5e-4, {2: 5e-4})
    assert np.isclose(one.runs[0].rounding.within(2.0).at[2], 1e-3)
