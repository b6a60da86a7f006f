"""Drawings with contours of which the kerf has no side: without area, with spurs or loops."""

import ezdxf
import numpy as np
import pytest
import yaml
from tests.geometry.tables import each

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import parse_job
from armcontour.program import Event, Lead, Process, Program, Rapid, arrange_contours, prepare

OUTER = [(0, 0), (60, 0), (60, 40), (0, 40)]
HOLE = [(12, 22), (18, 22), (18, 28), (12, 28)]
FLAT = [(10, 10), (20, 10)]
BAD = {
    "flat": FLAT,
    "folded": [(10, 10), (20, 10), (20, 15), (20, 10)],
    "spur": [(30, 10), (40, 10), (40, 20), (40.02, 20), (40, 20), (40, 30), (30, 30)],
    "inner spur": [(30, 10), (40, 10), (40, 20), (39.98, 20), (40, 20), (40, 30), (30, 30)],
    "spur at the start": [(30, 10), (30.02, 10.02), (30, 10), (40, 10), (40, 30), (30, 30)],
    "loop": [(30, 10), (40, 10), (40, 20), (40.02, 20), (40, 20.02), (40, 19.99), (40, 30)],
}
LEAD = Lead(2e-3, shape="arc")


def write_dxf(file, drawn):
    document = ezdxf.new(units=4)
    for points in drawn.values():
        document.modelspace().add_lwpolyline(points, close=True, dxfattribs={"layer": "CUT"})
    document.saveas(file)


def write_svg(file, drawn):
    paths = [
        f'<path id="{name}" d="M{"L".join(f"{x} {y}" for x, y in points)}Z"/>'
        for name, points in drawn.items()
    ]
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="40mm" viewBox="0 0 60 40">'
    file.write_text("\n".join([head, *paths, "</svg>"]))


def write_csv(file, drawn):
    rows = [f"{k},{x},{y}" for k, points in drawn.items() for x, y in [*points, points[0]]]
    file.write_text("\n".join(["contour,x [mm],y [mm]", *rows]) + "\n")


def write_gcode(file, drawn):
    lines = ["G21 G90", "F600"]
    for points in drawn.values():
        first, *others = [f"X{x} Y{y}" for x, y in [*points, points[0]]]
        lines += [f"G0 {first}", *(f"G1 {x}" for x in others)]
    file.write_text("\n".join([*lines, "M2"]) + "\n")


WRITERS = {"dxf": write_dxf, "svg": write_svg, "csv": write_csv, "nc": write_gcode}


def vertices(program):
    return [x.path.vertices for x in program.contours]


@each("ending", list(WRITERS))
@each("kind", list(BAD))
def test_contour_without_kerf_side_is_omitted_and_others_are_unchanged(tmp_path, ending, kind):
    write = WRITERS[ending]
    file = tmp_path / f"a.{ending}"
    write(file, {"outer": OUTER, "hole": HOLE})
    good = ac.read_path(file)
    write(file, {"outer": OUTER, "bad": BAD[kind], "hole": HOLE})
    drawn = ac.read_path(file)
    bad = drawn.contours[1]
    for values in ({}, {"lead_in": LEAD}, {"lead_in": LEAD, "lead_out": LEAD, "overlap": 1e-3}):
        for side in ("waste",) if values else ("waste", "left", "right"):
            expected = prepare(good, Process(kerf=1e-3, kerf_side=side, **values))
            prepared = prepare(drawn, Process(kerf=1e-3, kerf_side=side, **values))
            assert len(prepared.contours) == 2
            for x, y in zip(vertices(prepared), vertices(expected), strict=True):
                np.testing.assert_allclose(x, y, atol=1e-12)
            (note,) = (x for x in prepared.notes if "left out" in x)
            assert "contour 2" in note and bad.name in note and "kerf: 0 mm" in note
        # The remedy, and a process without a kerf: the contour is cut as drawn.
        zero = Process(kerf=1e-3, by_contour={bad.number: {"kerf": 0.0}}, begin="drawn")
        (same,) = (x for x in prepare(drawn, zero).contours if x.number == bad.number)
        np.testing.assert_array_equal(same.path.vertices, bad.path.vertices)
        assert len(prepare(drawn, Process(**values)).contours) == 3


def test_jobs_run_without_the_contour(tmp_path):
    write_dxf(tmp_path / "a.dxf", {"outer": OUTER, "bad": BAD["spur"], "hole": HOLE})
    data = {
        "name": "plate",
        "arm": "pmk3s",
        "path": {"file": "a.dxf", "frame": {"position": ["300 mm", "80 mm", 0]}},
        "process": {"kerf": "1 mm"},
        "servo": {"kp": 25, "kv": 150},
        "runs": {"plan": {"timing": {"method": "optimal"}}},
    }
    job = parse_job(yaml.safe_dump(data), source="plate.yaml", folder=tmp_path)
    arranged = arrange_contours(job.program, job.process)
    assert [x.name for x in arranged.contours] == ["CUT-3", "CUT-1"]
    assert [x.name for x in arranged.left_out] == ["CUT-2"]


def polyline(points):
    return ac.Path.polyline(1e-3 * np.array([*points, points[0]]))


def test_hole_inside_omitted_contour_is_still_cut_on_its_inside():
    spur = [(0, 0), (60, 0), (60, 20), (60.02, 20), (60, 20), (60, 40), (0, 40)]
    moves = tuple(ac.Contour(path=polyline(x)) for x in (spur, HOLE))
    (hole,) = prepare(Program(moves=moves), Process(kerf=1e-3, lead_in=LEAD)).contours
    low, high = 1e-3 * np.array([HOLE[0], HOLE[2]])
    points = hole.path(np.linspace(0, hole.path.length, 200))
    assert (points > low).all() and (points < high).all()


def test_a_drawing_without_another_contour_is_refused():
    alone = Program(moves=(ac.Contour(path=polyline(BAD["spur"])),))
    with pytest.raises(InvalidInput, match=r"contour 1 .*\(40, 20\) mm"):
        prepare(alone, Process(kerf=1e-3))
    # Events of a program may belong to the contour.
    good = ac.Contour(path=polyline(HOLE), keep_start=True)
    bad = ac.Contour(path=polyline(FLAT), keep_start=True)
    with pytest.raises(InvalidInput, match="contour 2 has no area"):
        prepare(Program(moves=(good, Event("laser"), bad)), Process(kerf=1e-3))
    to = Rapid(path=ac.Path.polyline([(0.012, 0.022), (0.01, 0.01)]))
    away = Rapid(path=ac.Path.polyline([(0.01, 0.01), (0.0, 0.0)]))
    last = ac.Contour(path=polyline(OUTER), keep_start=True)
    prepared = prepare(Program(moves=(good, to, bad, away, last)), Process(kerf=1e-3))
    paths = [x.path for x in prepared.moves]
    for x, y in zip(paths, paths[1:], strict=False):
        np.testing.assert_allclose(x(x.length), y(0.0), atol=1e-9)
