"""The report of a program: what stands in its figures is the study's, however long it is."""

import dataclasses
import re
import runpy
import sys
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plotly.offline import get_plotlyjs

import armcontour as ac
from armcontour.geometry.cutting import cut_path
from armcontour.io.cell import read_cell
from armcontour.io.drawings.read import read_path
from armcontour.jobs import run
from armcontour.program import Lead, Pierce, Process, Switch
from armcontour.report import render_report, sections
from armcontour.report.outline import VISIBLE, simplify
from armcontour.report.sections.bindings import MOST_BARS, bindings, merge_bindings
from armcontour.timing.explanation import Binding, Explanation

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


def study_of(folder, text, cell="pmk3s", **changes):
    file = folder / "program.ngc"
    file.write_text(text, encoding="utf-8")
    return run(dataclasses.replace(read_cell(cell, file), **changes))


def replace_runs(job, **changes):
    return dataclasses.replace(job, runs=[dataclasses.replace(x, **changes) for x in job.runs])


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return study_of(tmp_path_factory.mktemp("plane"), GCODE)


@pytest.fixture(scope="module")
def result(study):
    (found,) = study.runs.values()
    return found


@pytest.fixture(scope="module")
def in_space(tmp_path_factory):
    # Without compensation, so that errors are larger than what pictures round to.
    file = tmp_path_factory.mktemp("space") / "program.ngc"
    file.write_text(GCODE, encoding="utf-8")
    return run(replace_runs(read_cell("ur5e", file), compensation=ac.NoCompensation()))


def traces(figure):
    return {x.name: x for x in figure.data}


def points(trace):
    return np.stack([getattr(trace, x) for x in "xyz" if getattr(trace, x, None) is not None], -1)


def test_the_program_stands_between_overview_and_path(study, in_space, in_order):
    page = render_report(study)
    keys = "overview program paths joint-space speed bindings accelerations contour-error"
    in_order(page, keys)
    header = page[page.index("<header>") : page.index("</header>")]
    assert re.search(r"2 contours,\s+0.2114 m of path", header)
    keys = "overview program paths speed bindings joints contour-error"
    in_order(render_report(in_space), keys)


def test_the_picture_shows_contours_rapids_and_events_where_they_are(study, result):
    found = traces(sections.program(study).figures[0])
    contours = points(found["contours"]) * 1e-3
    for x in result.path.contours:
        for s, near in ((0.0, 1e-6), (x.path.length / 2, 0.03), (x.path.length, 1e-6)):
            assert np.nanmin(np.linalg.norm(contours - x.path(s), axis=1)) < near
    rapid = next(x for x in result.trajectory.spans if x.kind == "rapid")
    tool = result.execution.arm.tool_position(result.trajectory(np.linspace(*rapid.t, 3)))
    for place in tool[[0, 2]] * 1e3:
        assert np.nanmin(np.linalg.norm(points(found["rapids"]) - place, axis=1)) < 1e-3
    events, on = result.trajectory.events, found["spindle on"]
    np.testing.assert_allclose(points(on) * 1e-3, [x.point for x in events[::2]], atol=1e-6)
    assert "spindle = on" in on.text[0] and f"t = {events[0].t:.4f} s" in on.text[0]
    # A start and a middle for each of both contours, pointing along them.
    arrows = found["start and direction"]
    assert len(arrows.x) == 4
    assert arrows.marker.angle[0] == pytest.approx(90)  # to the right, clockwise from up


def test_the_drawn_contours_and_the_band_of_the_kerf_are_drawn():
    job = read_cell("ur5e", DRAWINGS / "plate.dxf")
    lead = Lead(length=2e-3, shape="arc", active=True)
    process = Process(kerf=1e-3, lead_in=lead, lead_out=Lead(length=2e-3, shape="arc"))
    study = run(
        replace_runs(dataclasses.replace(job, process=process), compensation=ac.NoCompensation())
    )
    found = traces(sections.program(study).figures[0])
    (result,) = study.runs.values()
    drawn, band = points(found["as drawn"]), points(found["kerf, 1 mm"])
    for contour in job.program.contours:
        assert np.nanmin(np.linalg.norm(drawn - 1e3 * contour.path(0.0), axis=1)) < 1e-3
    band = 1e-3 * band[~np.isnan(band[:, 0])]
    # Along the active lead-in, too, and not along the lead-out.
    cut = [cut_path(x.path, 0.0, x.at_work[1]) for x in result.path.contours]
    away = np.min([x.project(band).distance for x in cut], axis=0)
    assert away.max() == pytest.approx(0.5e-3, abs=1e-6)
    assert np.median(away) == pytest.approx(0.5e-3, abs=1e-6)
    assert max(np.linalg.norm(band - x(0.0), axis=1).min() for x in cut) <= 0.501e-3
    assert "leads" in found and "leads, tool off" not in found


@given(st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=40), st.integers(1, 200))
def test_bars_of_what_binds_cover_the_length_and_are_bounded(widths, times):
    ends = np.concatenate([[0.0], np.cumsum(widths * times)])
    found = tuple(
        Binding(limit=f"limit {i % 3}", joint=None, t=(2 * a, 2 * b), s=(a, b), share=1.0)
        for i, (a, b) in enumerate(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))
    )
    why = Explanation(bindings=found, assigned_length=None, assigned_time=None, shortfalls=())
    bars = sorted(x for of in merge_bindings(why).values() for x in of)
    assert len(bars) <= MOST_BARS
    assert bars[0][0] == 0.0 and bars[-1][1] == ends[-1]
    for first, second in zip(bars[:-1], bars[1:], strict=True):
        assert first[1] == second[0] and first[3] == second[2]


SHARE = st.floats(-1, 1)
CURVE = st.lists(st.tuples(SHARE, SHARE), min_size=2, max_size=30)


@given(st.lists(CURVE, min_size=1, max_size=4))
def test_simplified_curves_stay_within_what_is_not_seen(curves):
    found = [np.array(x) for x in curves]
    size = np.ptp(np.concatenate(found), axis=0).max()
    for points, kept in zip(found, simplify(found, even=1), strict=True):
        assert kept[0] == 0 and kept[-1] == len(points) - 1
        assert (np.diff(kept) > 0).all()
        for i, x in enumerate(points):
            k = min(max(int(np.searchsorted(kept, i, side="right")) - 1, 0), len(kept) - 2)
            a, b = points[kept[k]], points[kept[k + 1]]
            along = b - a
            share = np.clip((x - a) @ along / max(along @ along, 1e-300), 0, 1)
            assert np.linalg.norm(x - a - share * along) <= VISIBLE * size + 1e-12


def test_a_long_program_has_a_small_report(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[bindings.__module__], "MOST_BARS", 50)
    lines = ["G21 G90 G64 P0.2", "G0 X0 Y0", "M3"]
    for row in range(24):
        for i in range(1, 101):
            x = i if row % 2 == 0 else 100 - i
            lines.append(f"G1 X{x} Y{row + 0.2 * (i % 2):g} F6000")
    long = study_of(tmp_path, "\n".join(lines))
    assert len(render_report(long)) - len(get_plotlyjs()) < 1.5e6
    bars = sum(len(x.x) for x in bindings(long).figures[0].data if x.type == "bar")
    (result,) = long.runs.values()
    assert bars <= 50 < len(result.explanation.bindings)


@pytest.mark.parametrize(
    "name, cell, path",
    [
        ("lettering.svg", "pmk3s", {}),
        ("pocket.ngc", "pmk3s", {"flat": True}),
        ("gasket.dxf", DRAWINGS / "laser.yaml", {"names": ["handle 33", "handle 38"]}),
    ],
)
def test_a_sample_drawing_runs_to_a_report(name, cell, path):
    done = run(read_cell(cell, DRAWINGS / name, path=path))
    page = render_report(done)
    assert '<section id="program">' in page and name in page
    (result,) = done.runs.values()
    assert result.evaluation.contour_error.max < 1e-4
    # The ports of the gasket are slower than assigned from where they begin, and the arcs of the
    # pocket have three decimals.
    known = ("handle 38", "Mended ")
    assert all(any(part in x for part in known) for x in result.warnings)
    assert any("Mended " in x for x in result.warnings) == (name == "pocket.ngc")


def test_the_sample_drawings_are_what_their_script_writes(tmp_path):
    runpy.run_path(str(DRAWINGS / "make.py"))["main"](tmp_path)
    names = ["gasket.dxf", "lettering.svg", "plate.dxf", "pocket.ngc"]
    assert sorted(x.name for x in tmp_path.iterdir()) == names
    for name in names:
        shipped, again = read_path(DRAWINGS / name), read_path(tmp_path / name)
        assert [x.layer for x in again.contours] == [x.layer for x in shipped.contours]
        for one, other in zip(again.contours, shipped.contours, strict=True):
            np.testing.assert_allclose(one.path.vertices, other.path.vertices, atol=1e-12)
            np.testing.assert_allclose(one.path.lengths, other.path.lengths, atol=1e-12)
        if not name.endswith(".dxf"):  # whose bytes depend on the version of ezdxf
            assert (tmp_path / name).read_bytes() == (DRAWINGS / name).read_bytes()


def test_leads_and_pierces_are_told_apart(tmp_path):
    switch, pierce = Switch(name="laser"), Pierce(time=0.1, height=4e-3)
    leads = {"lead_in": Lead(length=3e-3, active=True), "lead_out": Lead(length=2e-3)}
    process = Process(switch=switch, pierce=pierce, **leads)
    study = study_of(tmp_path, GCODE, "ur5e", process=process)
    (table,) = sections.program(study).tables
    for row in table.rows:
        cells = dict(zip(table.header, row, strict=True))
        assert cells["leads [mm]"] == "3.00, 2.00" and cells["pierce [mm]"] == "4.00"
