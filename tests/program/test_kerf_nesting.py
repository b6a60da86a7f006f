"""The side of a kerf in nested contours, whichever of them has a kerf, judged by ray casting."""

import ezdxf
import numpy as np
import pytest
import yaml
from tests.geometry.tables import each

import armcontour as ac
from armcontour.files import parse_job
from armcontour.program import Process, Program, arrange_contours, prepare

KERF = 1e-3
LAYERS = ("A", "B", "C")
JOB = {
    "name": "rings",
    "arm": "pmk3s",
    "servo": {"kp": 25, "kv": 150},
    "runs": {"plan": {"timing": {"method": "optimal"}}},
}


def rings(rng, center=(0.0, 0.0), radius=0.2, depth=0):
    """Random polygons in a circle, which contain smaller ones; clockwise or not, in any order."""
    n = int(rng.integers(3, 9))
    angles = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(n) / n
    corners = center + 0.9 * radius * np.column_stack([np.cos(angles), np.sin(angles)])
    found = [corners[:: rng.choice([-1, 1])]]
    inner = 0.8 * 0.9 * radius * np.cos(np.pi / n)
    if depth < 3:
        aside = np.array([inner / 2, 0.0])
        parts = (
            [(center, inner)]
            if n < 5
            else [(center - aside, inner / 2), (center + aside, inner / 2)]
        )
        for place, size in parts:
            if depth == 0 or rng.random() < 0.8:
                found += rings(rng, place, size, depth + 1)
    rng.shuffle(found)
    return found


def holds(polygon, point):
    """Whether a point is in a polygon: a ray from it crosses an odd number of edges."""
    x, y = point
    odd = False
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if (a[1] > y) != (b[1] > y) and x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]):
            odd = not odd
    return odd


def goes_inside(polygons, k):
    """Whether the cut along polygon k lies in it, because an odd number of others holds it."""
    others = [x for i, x in enumerate(polygons) if i != k]
    return sum(holds(x, polygons[k][0]) for x in others) % 2 == 1


def check_sides(polygons, contours, has_kerf):
    """Every contour with kerf is offset to its side in the whole drawing, the others are not."""
    for k, polygon in enumerate(polygons):
        (path,) = (x.path for x in contours if x.number == k + 1)
        points = path(np.linspace(0, path.length, 60, endpoint=False))
        if has_kerf[k]:
            assert {holds(polygon, x) for x in points} == {goes_inside(polygons, k)}
        else:
            assert path.length == pytest.approx(closed(polygon).length, abs=1e-9)


def closed(polygon):
    return ac.Path.polyline([*polygon, polygon[0]])


def drawn(polygons, layers):
    moves = [
        ac.Contour(path=closed(x), number=k + 1, layer=str(layers[k]))
        for k, x in enumerate(polygons)
    ]
    return Program(moves=tuple(moves))


@each("seed", range(12))
def test_contours_with_kerf_are_cut_on_same_side_as_in_whole_drawing(seed):
    rng = np.random.default_rng(seed)
    polygons = rings(rng)
    layers = rng.choice(LAYERS, len(polygons))
    program = drawn(polygons, layers)
    some = rng.random(len(polygons)) < 0.5
    by_contour = {k + 1: {"kerf": KERF} for k in np.flatnonzero(some).tolist()}
    contours = prepare(program, Process(begin="drawn", by_contour=by_contour)).contours
    check_sides(polygons, contours, some)
    layer = str(layers[0])
    process = Process(begin="drawn", by_layer={layer: {"kerf": KERF}})
    check_sides(polygons, prepare(program, process).contours, layers == layer)
    # A contour without offset that is cut also counts.
    zero = {x: {"kerf": 0.0} for x in set(layers.tolist()) - {layer}}
    process = Process(begin="drawn", kerf=KERF, by_layer=zero)
    check_sides(polygons, prepare(program, process).contours, layers == layer)


@each("seed", range(6))
def test_jobs_that_select_contours_keep_kerf_sides_of_whole_drawing(tmp_path, seed):
    rng = np.random.default_rng(100 + seed)
    polygons = rings(rng)
    layers = rng.choice(LAYERS, len(polygons))
    document = ezdxf.new(units=4)
    for polygon, layer in zip(polygons, layers, strict=True):
        document.modelspace().add_lwpolyline(1e3 * polygon, close=True, dxfattribs={"layer": layer})
    document.saveas(tmp_path / "rings.dxf")
    named = [x.name for x in ac.read_path(tmp_path / "rings.dxf").contours]

    def arranged(contours=None, **process):
        path = {"file": "rings.dxf", "contours": contours or {}}
        data = {**JOB, "path": path, "process": process}
        job = parse_job(yaml.safe_dump(data), source="rings.yaml", folder=tmp_path)
        return arrange_contours(job.program, job.process).contours

    some = rng.random(len(polygons)) < 0.5
    some[0] = True
    values = {named[k]: {"kerf": "1 mm"} for k in np.flatnonzero(some).tolist()}
    check_sides(polygons, arranged(values), some)
    layer = str(layers[0])
    by_layer = {layer: {"kerf": "1 mm"}}
    check_sides(polygons, arranged(by_layer=by_layer), layers == layer)


def square(half):
    return np.array([(-half, -half), (half, -half), (half, half), (-half, half)])


def test_contour_without_kerf_does_not_change_kerf_side_of_others():
    polygons = [square(0.1), square(0.05), square(0.02)]
    program = drawn(polygons, ["CUT", "MARK", "CUT"])
    marked = Process(kerf=KERF, begin="drawn", by_layer={"MARK": {"kerf": None}})
    prepared = prepare(program, marked)
    # The hole in the plate is also a hole inside the engraved square.
    check_sides([polygons[0], polygons[2]], renumbered(prepared), [True, True])
    (note,) = prepared.notes
    assert "contour 3 is cut inside" in note and "contour 2" in note
    counted = prepare(program, Process(begin="drawn", by_layer={"CUT": {"kerf": KERF}}))
    check_sides(polygons, counted.contours, [True, False, True])
    (note,) = counted.notes
    assert "contour 3 is cut outside" in note and "contour 2" in note
    # A hole without its outline is cut outside, which a note says.
    alone = prepare(program.selected(layers=["MARK"]), Process(kerf=KERF, begin="drawn"))
    (note,) = alone.notes
    assert "contour 2 is cut outside" in note and "contour 1" in note
    assert prepare(program, Process(kerf=KERF, begin="drawn")).notes == ()
    inner = program.selected(layers=["CUT"])
    (note,) = prepare(inner, Process(kerf=KERF, begin="drawn")).notes
    assert "contour 3 is cut inside" in note and "contour 2" in note


def renumbered(program):
    """The contours of the layer CUT, with numbers from 1."""
    cut = sorted((x for x in program.contours if x.layer == "CUT"), key=lambda x: x.number)
    return [ac.Contour(path=x.path, number=k + 1) for k, x in enumerate(cut)]
