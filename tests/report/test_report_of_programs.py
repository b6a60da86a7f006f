"""The report of a program: its values equal those of the job_result, also for long programs."""

import dataclasses
import re
from pathlib import Path as FilePath

import ezdxf
import numpy as np
import pytest
from tests.dynamics_extra import mark_all_but, needs_dynamics

import armcontour as ac
from armcontour.core.render import LIMITS, number
from armcontour.files.job_file import read_cell
from armcontour.jobs import run
from armcontour.program import Lead, Process
from armcontour.report import render_report
from armcontour.report.plan_drawing import draw_plan

DRAWINGS = FilePath(__file__).parents[2] / "examples" / "drawings"
GCODE = """G21 G90 G64 P0.5
G0 X10 Y10
M3
G1 X60 F3000
Y60 F2400
G3 X40 Y60 I-10 J0
M5
G0 X80 Y80
M3
G1 X120 F3000
Y120
M5
G4 P0.5
G0 X0 Y0
"""


def job_result_of(folder, text, cell="pmk3s", **changes):
    file = folder / "program.ngc"
    file.write_text(text, encoding="utf-8")
    return run(dataclasses.replace(read_cell(cell, file), **changes))


def replace_runs(job, **changes):
    return dataclasses.replace(job, runs=[dataclasses.replace(x, **changes) for x in job.runs])


@pytest.fixture(scope="module")
def job_result(tmp_path_factory):
    return job_result_of(tmp_path_factory.mktemp("plane"), GCODE)


@pytest.fixture(scope="module")
def result(job_result):
    (run,) = job_result.runs.values()
    return run


@pytest.fixture(scope="module")
def in_space(tmp_path_factory):
    # Without compensation, so that errors are larger than what pictures round to.
    file = tmp_path_factory.mktemp("space") / "program.ngc"
    file.write_text(GCODE, encoding="utf-8")
    return run(replace_runs(read_cell("ur5e", file), compensation=ac.NoCompensation()))


def test_layers_that_are_not_run_are_named_once(tmp_path):
    drawing = ezdxf.new()
    drawing.units = ezdxf.units.MM
    for k, layer in enumerate(("CUT", "FRAME")):
        drawing.modelspace().add_circle((100 + 30 * k, 100), 8, dxfattribs={"layer": layer})
    drawing.saveas(tmp_path / "rings.dxf")
    job = read_cell("pmk3s", tmp_path / "rings.dxf", patch={("path", "layers"): ["CUT"]})
    (run_of_cell, *_) = job.runs
    runs = [dataclasses.replace(run_of_cell, name=name) for name in ("first", "second")]
    page = render_report(run(dataclasses.replace(job, runs=runs)))
    assert page.count("FRAME (1)") == 1


@needs_dynamics
def test_contours_have_a_table(job_result, in_space, in_order):
    page = render_report(job_result)
    in_order(page, "figures contours time paths joints")
    header = page[page.index("<header>") : page.index("</header>")]
    assert "2 contours" in header and "211 mm as drawn" in header
    in_order(render_report(in_space), "figures contours time paths joints")


def drawn_paths(svg):
    """Points of the paths of a drawing [px], by their titles, with a gap (NaN) after each part."""
    paths = {}
    for look, d, title in re.findall(
        r'<path class="([^"]*)"[^>]* d="([^"]*)">(?:<title>([^<]*)</title>)?', svg
    ):
        parts = [np.array(x.split(), dtype=float).reshape(-1, 2) for x in d.split("M")[1:]]
        gap = np.full((1, 2), np.nan)
        paths[title or look] = np.concatenate([y for x in parts for y in (x, gap)])
    return paths


def marked(svg, name):
    """Positions of marks of a kind [px]."""
    pattern = (
        rf'<use href="#mark-{name}" (?:x="|transform="translate\()([-\d.]+)(?:" y="| )([-\d.]+)'
    )
    return np.array(re.findall(pattern, svg), dtype=float)


def distances(points, curve):
    """Least distances of points from a curve with gaps [px]."""
    a = curve[:-1]
    b = curve[1:]
    defined = ~np.isnan(a + b).any(axis=1)
    along = (b - a)[defined]
    a = a[defined]
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((points[:, None] - a) * along).sum(axis=2) / square, 0.0, 1.0)
    return np.linalg.norm(points[:, None] - a - share[..., None] * along, axis=2).min(axis=1)


def fitted(svg, result):
    """Map of points into a drawing, fitted to its marks, and pixels per metre."""
    events = sorted(result.trajectory.events, key=lambda x: x.value is False)
    events = [x.point for x in events]
    marks = [marked(svg, x) for x in ("start", "on", "off") if f"#mark-{x}" in svg]
    points = np.array([*(x.path(0.0) for x in result.path.contours), *events])
    points = np.column_stack([points, np.ones(len(points))])
    transform, *_ = np.linalg.lstsq(points, np.concatenate(marks), rcond=None)
    np.testing.assert_allclose(points @ transform, np.concatenate(marks), atol=0.2)
    sizes = np.linalg.svd(transform[:-1], compute_uv=False)
    # Equal lengths are equal on the screen.
    assert sizes[0] == pytest.approx(sizes[1], rel=1e-2)
    return lambda x: np.column_stack([x, np.ones(len(x))]) @ transform, sizes[0]


@pytest.mark.parametrize("fixture", mark_all_but(["job_result", "in_space"], ["job_result"]))
def test_the_drawing_shows_the_active_limit_at_each_point(fixture, request):
    job_result = request.getfixturevalue(fixture)
    (result,) = job_result.runs.values()
    drawing = draw_plan(result, job_result.job)
    paths = drawn_paths(drawing.svg)
    place, size = fitted(drawing.svg, result)
    rapids = paths.pop("limit")
    bindings = result.explanation.bindings
    paths.pop("as drawn", None)
    limits = {x.limit: x.limit for x in bindings} | {"nothing": "between two limits"}
    words = {x: LIMITS[y].get("word", y) for x, y in limits.items()}
    assert set(paths) <= set(words.values())
    segments_seen = 0
    for x in bindings:
        s = np.linspace(*x.s, 5)[1:-1]
        k = int(np.searchsorted(result.path.breaks, s[0], side="right")) - 1
        points = result.path.contours[k].path(s - result.path.breaks[k])
        if (x.s[1] - x.s[0]) * size > 3.0:
            assert distances(place(points), paths[words[x.limit]]).max() < 1.0, x
            segments_seen += 1
    assert segments_seen > 5
    for span in result.trajectory.spans:
        if span.kind == "rapid":
            tool = result.arm.tool_position(result.trajectory(np.linspace(*span.t, 9)[1:-1]))
            assert distances(place(tool), rapids).max() < 2.0
    assert f"spindle = on, t = {number(result.trajectory.events[0].t, 's')}" in drawing.svg
    # The times of the legend add up to the motion, but for what is too short to be listed.
    total = sum(x.time for x in drawing.legend)
    assert total == pytest.approx(result.trajectory.duration, rel=0.02)


@needs_dynamics
def test_the_drawing_shows_kerf_leads_and_the_drawn_contours():
    job = read_cell("ur5e", DRAWINGS / "plate.dxf")
    lead = Lead(length=2e-3, shape="arc", active=True)
    process = Process(kerf=1e-3, lead_in=lead, lead_out=Lead(length=2e-3, shape="arc"))
    changed = dataclasses.replace(job, process=process)
    (result,) = run(replace_runs(changed, compensation=ac.NoCompensation())).runs.values()
    svg = draw_plan(result, changed).svg
    paths = drawn_paths(svg)
    _, size = fitted(svg, result)
    assert {"kerf 1 mm", "lead", "as drawn"} <= set(paths)
    (width,) = re.findall(r'class="kerf" stroke-width="([\d.]+)"', svg)
    assert float(width) == pytest.approx(1e-3 * size, rel=0.02)
    # The middle of the band is half a kerf from what is drawn.
    drawn = paths["as drawn"]
    away = distances(drawn[~np.isnan(drawn[:, 0])], paths["kerf 1 mm"])
    assert np.median(away) == pytest.approx(0.5e-3 * size, abs=0.3)


@needs_dynamics
def test_the_drawing_shows_the_process_and_links_to_extremes():
    changes = {("process", "tabs"): {"count": 2, "width": "3 mm"}}
    changes[("process", "pierce")] = {"time": "0.2 s"}
    changes[("process", "lead_in")] = {"length": "auto", "shape": "arc", "active": True}
    job = read_cell(DRAWINGS / "laser.yaml", DRAWINGS / "gasket.dxf", patch=changes)
    job_result = run(job)
    (result,) = job_result.runs.values()
    drawing = draw_plan(result, job)
    count = len(result.path.contours)
    for name in ("start", "pierce", "on", "off"):
        assert 1 <= len(marked(drawing.svg, name)) <= count, name
    gaps = drawn_paths(drawing.svg)["tab, not cut"]
    assert np.isnan(gaps[:, 0]).sum() == 2 * count
    where = places_in(drawing.svg)
    assert {x.place for x in drawing.legend if x.place} <= set(where)
    page = render_report(job_result)
    assert set(drawing.places) == {"off_drawing", "clearance.low", "slowest", "time_limit"}
    for target in drawing.places.values():
        assert f'href="#{target}"' in page and page.count(f'id="{target}"') == 1


def places_in(svg):
    """Positions of the places to which links lead [px], by id."""
    pattern = r'<circle id="([^"]*)" class="place" cx="([\d.]+)" cy="([\d.]+)"'
    return {x: np.array([float(a), float(b)]) for x, a, b in re.findall(pattern, svg)}


def test_links_of_values_point_to_where_they_occur(job_result, result):
    drawing = draw_plan(result, job_result.job)
    place, _ = fitted(drawing.svg, result)
    worst = result.verdict.contour
    s = result.judged.drawing_errors[worst].s_max - result.path.breaks[worst]
    off = result.objective.contours[worst].path(s)
    slow = min(result.explanation.shortfalls, key=lambda x: x.speed / x.assigned)
    k = int(np.searchsorted(result.path.breaks, slow.s, side="right")) - 1
    slowest = result.path.contours[k].path(slow.s - result.path.breaks[k])
    for row, point in (("off_drawing", off), ("slowest", slowest)):
        away = place(point[None])[0] - places_in(drawing.svg)[drawing.places[row]]
        assert np.linalg.norm(away) < 1.0, row


def test_a_drawing_of_many_contours_is_small_and_exact(tmp_path):
    lines = ["G21 G90"]
    for k in range(100):
        x = 6 * (k % 10)
        y = 6 * (k // 10)
        lines += [f"G0 X{x} Y{y}", f"G1 X{x + 4} F6000", f"Y{y + 4}", f"X{x}", f"Y{y}"]
    job_result = job_result_of(tmp_path, "\n".join(lines))
    (result,) = job_result.runs.values()
    svg = draw_plan(result, job_result.job).svg
    assert len(svg) < 140_000
    paths = drawn_paths(svg)
    place, _ = fitted(svg, result)
    rapids = paths.pop("limit")
    # Every contour has all of its corners, and every rapid its ends, to half a pixel.
    every = np.concatenate(list(paths.values()))
    corners = place(np.concatenate([x.path.vertices for x in result.path.contours]))
    ends = place(np.concatenate([x.path.vertices[:1] for x in result.path.contours]))
    assert max(distances(x, every).max() for x in np.array_split(corners, 30)) < 0.6
    assert max(distances(x, rapids).max() for x in np.array_split(ends, 30)) < 0.6


@pytest.mark.parametrize(
    "name, cell, path",
    [
        ("lettering.svg", "pmk3s", {}),
        ("pocket.ngc", "pmk3s", {("path", "ignore_z"): True}),
        ("gasket.dxf", DRAWINGS / "laser.yaml", {("path", "names"): ["CUT-1", "CUT-6"]}),
    ],
)
def test_a_sample_drawing_runs_to_a_report(name, cell, path):
    done = run(read_cell(cell, DRAWINGS / name, patch=path))
    page = render_report(done)
    assert '<details id="contours">' in page and name in page
    (result,) = done.runs.values()
    assert result.evaluation.contour_error.max < 1e-4
    # The ports of the gasket are slower than assigned from where they begin, and limits of the
    # set-points cost much of what is allowed there. The arcs of the pocket have three decimals.
    # Without the extra, distances of the links are not checked.
    expected = ("CUT-6", "limits of the set-points", "Repaired ", "armcontour[dynamics]")
    assert all(any(part in x for part in expected) for x in result.warnings)
    assert any("Repaired " in x for x in result.warnings) == (name == "pocket.ngc")
