"""Jobs out of reach: the worst place of the contours, in the drawing too, and what mends it."""

import dataclasses
import re

import numpy as np
import pytest
import yaml
from tests.properties.number_cases import PLANE, SPACE

import armcontour as ac
from armcontour.io import parse_job
from armcontour.jobs import teach

# A square of 40 mm beside the base of the planar arm, whose reach is 465 mm, and far from it.
SQUARE = [[0, 0], [0.04, 0], [0.04, 0.04], [0, 0.04], [0, 0]]


def taught(base, **changed):
    return teach(parse_job(yaml.safe_dump(base | changed)))


def refusal(base, **changed):
    with pytest.raises(ac.Unreachable) as caught:
        taught(base, **changed)
    return caught.value, str(caught.value)


def way(said):
    """The way of the part that the message proposes [mm]."""
    found = re.search(r"move the part by \(([^)]*)\) mm", said)
    return np.array([float(x) for x in found[1].split(",")])


def in_place(points, *position, **more):
    return {"points": points, "frame": {"position": [float(x) for x in position]}, **more}


def test_the_worst_place_is_said_in_the_coordinates_of_the_drawing():
    error, said = refusal(PLANE, path=in_place(SQUARE, 0.6, 0.0, 0.0))
    # The corner that is farthest from the base, at (135, 0) mm, and nothing before it.
    far = np.hypot(0.64 - 0.135, 0.04)
    assert error.point == pytest.approx((0.64, 0.04)) and error.s == pytest.approx(0.08)
    assert error.needed == pytest.approx(far - 0.465) and error.limit == "reach"
    assert f"by up to {(far - 0.465) * 1e3:.4g} mm, most at (640, 40) mm" in said
    assert "which is (40, 40) mm before path.frame" in said


def test_what_is_said_to_mend_it_does():
    # Too far from the base, and too near.
    for position in ([0.6, 0.0], [0.12, -0.02]):
        said = refusal(PLANE, path=in_place(SQUARE, *position, 0.0))[1]
        assert "armcontour place" in said
        assert taught(PLANE, path=in_place(SQUARE, *(position + 1e-3 * way(said)), 0.0))


def test_contours_are_refused_before_the_rapids_to_them():
    def approached(x, height):
        path = in_place([[*p, 0.0] for p in SQUARE], x, 0.0, 0.2, orientation={"axis": [0, 0, -1]})
        process = {"approach": height}
        return refusal(SPACE, path=path, process=process, corners="sharp", start=None)

    error, said = approached(0.9, 0.3)
    assert "Run one: The path is out of reach" in said or "contour 1 is out" in said.lower()
    assert error.point[2] == pytest.approx(0.2)
    # The part stays on its table.
    assert way(said)[2] == 0
    _, said = approached(0.45, 1.0)
    assert "Rapid to contour 1 is out of reach" in said and "take a smaller approach" in said


def test_of_very_many_contours_the_worst_is_found():
    near, far = (ac.Path.polyline([(x, 0.2), (x + 0.01, 0.2)]) for x in (0.3, 0.8))
    moves = (*[ac.Contour(path=near)] * 299, ac.Contour(path=far), *[ac.Contour(path=near)] * 100)
    job = parse_job(yaml.safe_dump(PLANE | {"corners": "sharp"}))
    with pytest.raises(ac.Unreachable, match="Contour 300 is out of reach"):
        teach(dataclasses.replace(job, path=ac.Program(moves=moves)))
