"""Jobs out of reach: the worst place of the contours, in the drawing too, and what mends it."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np
import pytest
import yaml
from soak.number_cases import PLANE, SPACE

import armcontour as ac
from armcontour.io import parse_job
from armcontour.jobs import teach

# A square of 40 mm beside the base of the planar arm, whose reach is 465 mm, and far from it.
SQUARE = [[0, 0], [0.04, 0], [0.04, 0.04], [0, 0.04], [0, 0]]
WAY = re.compile(r"move the part by \(([^)]*)\) mm")


def refused(base: dict[str, Any], **changed: Any) -> ac.Unreachable:
    with pytest.raises(ac.Unreachable) as caught:
        teach(parse_job(yaml.safe_dump(base | changed)))
    return caught.value


def in_place(points: list[list[float]], *position: float, **more: Any) -> dict[str, Any]:
    return {"points": points, "frame": {"position": list(position)}, **more}


def test_the_worst_place_is_said_in_the_coordinates_of_the_drawing() -> None:
    error = refused(PLANE, path=in_place(SQUARE, 0.6, 0.0, 0.0))
    # The corner that is farthest from the base, at (135, 0) mm, and nothing before it.
    far = np.hypot(0.64 - 0.135, 0.04)
    assert error.point == pytest.approx((0.64, 0.04)) and error.s == pytest.approx(0.08)
    assert error.needed == pytest.approx(far - 0.465) and error.limit == "reach"
    assert f"by up to {(far - 0.465) * 1e3:.4g} mm, most at (640, 40) mm" in str(error)
    assert "which is (40, 40) mm before path.frame" in str(error)


def test_what_is_said_to_mend_it_does() -> None:
    # Too far from the base, and too near.
    for position in ([0.6, 0.0, 0.0], [0.12, -0.02, 0.0]):
        said = str(refused(PLANE, path=in_place(SQUARE, *position)))
        found = WAY.search(said)
        assert found and ("armcontour place" in said)
        way = np.array([float(x) for x in found[1].split(",")]) * 1e-3
        moved = [*(np.array(position[:2]) + way).tolist(), 0.0]
        assert teach(parse_job(yaml.safe_dump(PLANE | {"path": in_place(SQUARE, *moved)})))


def test_contours_are_refused_before_the_rapids_to_them() -> None:
    turned = {"orientation": {"axis": [0, 0, -1]}}
    points = [[*x, 0.0] for x in SQUARE]
    path = in_place(points, 0.9, 0.0, 0.2, **turned)
    approach = {"approach": 0.3}
    error = refused(SPACE, path=path, process=approach, corners="sharp", start=None)
    assert (
        "Run one: The path is out of reach" in str(error)
        or "contour 1 is out" in str(error).lower()
    )
    assert error.point is not None and error.point[2] == pytest.approx(0.2)
    found = WAY.search(str(error))
    assert found
    # The part stays on its table.
    assert float(found[1].split(",")[2]) == 0
    near = in_place(points, 0.45, 0.0, 0.2, **turned)
    error = refused(SPACE, path=near, process={"approach": 1.0}, corners="sharp", start=None)
    assert "Rapid to contour 1 is out of reach" in str(error)
    assert "all contours are in reach: take a smaller approach" in str(error)


def test_of_very_many_contours_the_worst_is_found() -> None:
    hole = ac.Path.polyline([(0.3, 0.2), (0.31, 0.2)])
    shifts = [(0.0, 0.0)] * 999 + [(0.5, 0.0)] + [(0.0, 0.0)] * 200
    moves = tuple(
        ac.Contour(path=ac.Program.of(hole).placed(ac.Frame(position=np.array([*x, 0.0]))).path)
        for x in shifts
    )
    job = parse_job(yaml.safe_dump(PLANE | {"corners": "sharp"}))
    with pytest.raises(ac.Unreachable) as caught:
        teach(dataclasses.replace(job, path=ac.Program(moves=moves)))
    assert "Contour 1000 is out of reach" in str(caught.value)
