"""Jobs whose path is out of reach are refused with the worst point of the drawing."""

import dataclasses

import numpy as np
import pytest
import yaml
from tests.properties.number_cases import PLANE, SPACE

import armcontour as ac
from armcontour.files import parse_job
from armcontour.jobs import run

# Reach of the planar arm, whose base is at (135, 0) mm [m].
REACH = 0.465
BASE_X = 0.135
# A square of 40 mm [m].
SQUARE = [[0, 0], [0.04, 0], [0.04, 0.04], [0, 0.04], [0, 0]]


def refusal_of(base, **changed):
    """Run a job whose path cannot be reached, and return the error."""
    job = parse_job(yaml.safe_dump(base | changed))
    with pytest.raises(ac.Unreachable) as caught:
        run(job, simulate=False)
    return caught.value


def placed_path(points, x, y, z, **keys):
    """Return the job's key `path`, with its part frame at a position [m]."""
    return {"points": points, "frame": {"position": [x, y, z]}, **keys}


def test_worst_point_is_reported_in_coordinates_of_base_and_drawing():
    error = refusal_of(PLANE, path=placed_path(SQUARE, 0.6, 0.0, 0.0))
    # The corner that is farthest from the base, and nothing before it.
    excess = np.hypot(0.64 - BASE_X, 0.04) - REACH
    assert error.point == pytest.approx((0.64, 0.04))
    assert error.s == pytest.approx(0.08)
    assert error.needed == pytest.approx(excess)
    assert error.limit == "reach"
    message = str(error)
    assert f"by up to {excess * 1e3:.3g} mm, most at (640, 40) mm" in message
    assert "which is (40, 40) mm before path.frame" in message


def refusal_of_approach(x, height):
    """Return the error of a square at `x` that is approached from a height [m]."""
    square = [[*point, 0.0] for point in SQUARE]
    path = placed_path(square, x, 0.0, 0.2, orientation={"axis": [0, 0, -1]})
    return refusal_of(SPACE, path=path, process={"approach": height}, corners="sharp", seed=None)


def test_unreachable_contour_is_refused_before_the_rapid_to_it():
    error = refusal_of_approach(x=0.9, height=0.3)
    assert "rapid" not in str(error).lower()
    assert error.point[2] == pytest.approx(0.2)


def test_unreachable_rapid_is_refused_with_a_smaller_approach_as_remedy():
    message = str(refusal_of_approach(x=0.45, height=1.0))
    assert "Rapid to contour 1 is out of reach" in message
    assert "Use a smaller approach" in message


def test_unreachable_contour_is_found_among_hundreds():
    near = ac.Contour(path=ac.Path.polyline([(0.3, 0.2), (0.31, 0.2)]))
    far = ac.Contour(path=ac.Path.polyline([(0.8, 0.2), (0.81, 0.2)]))
    moves = (*[near] * 299, far, *[near] * 100)
    job = parse_job(yaml.safe_dump(PLANE | {"corners": "sharp"}))
    with pytest.raises(ac.Unreachable, match="Contour 300 is out of reach"):
        run(dataclasses.replace(job, path=ac.Program(moves=moves)), simulate=False)
