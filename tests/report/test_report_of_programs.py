"""The report of a program: what stands in its figures is the study's, however long it is."""

from __future__ import annotations

import dataclasses
import re
import runpy
import sys
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armcontour.evaluation import evaluate
from armcontour.geometry import Demand, Line, Path
from armcontour.geometry.cutting import cut_path
from armcontour.io.cell import read_cell
from armcontour.io.drawings.read import read_path
from armcontour.jobs import Job, Study, run
from armcontour.motion import Span
from armcontour.program import Contour, Event, Lead, Process, Program, Switch
from armcontour.report import render_report, sections
from armcontour.report.outline import MOST_DRAWN, VISIBLE, outline_points, simplify
from armcontour.report.sections.along import assigned_speeds, planned_speeds
from armcontour.report.sections.bindings import MOST_BARS, bindings, merge_bindings
from armcontour.report.sections.program import MOST_ROWS
from armcontour.report.sections.program_picture import MOST_MARKERS, mark_events, said
from armcontour.report.sections.program_timeline import merge_moves
from armcontour.report.style import MOST_SENTENCES, few
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


def study_of(folder: FilePath, text: str, cell: str = "pmk3s", **changes: Any) -> Study:
    file = folder / "program.ngc"
    file.write_text(text, encoding="utf-8")
    return run(dataclasses.replace(read_cell(cell, file), **changes))


def replace_runs(job: Job, **changes: Any) -> Job:
    return dataclasses.replace(job, runs=[dataclasses.replace(x, **changes) for x in job.runs])


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return study_of(tmp_path_factory.mktemp("plane"), GCODE)


@pytest.fixture(scope="module")
def in_space(tmp_path_factory: pytest.TempPathFactory) -> Study:
    # Without compensation, so that errors are larger than what pictures round to.
    file = tmp_path_factory.mktemp("space") / "program.ngc"
    file.write_text(GCODE, encoding="utf-8")
    job = read_cell("ur5e", file)
    return run(replace_runs(job, compensation="none"))


@pytest.fixture(scope="module")
def led(tmp_path_factory: pytest.TempPathFactory) -> Study:
    lead = Lead(length=0.01)
    process = Process(lead_in=lead, lead_out=lead, switch=Switch(name="<b>", on_lead=0.05))
    return study_of(tmp_path_factory.mktemp("led"), GCODE, process=process)


def traces(figure: Any) -> dict[str, Any]:
    return {x.name: x for x in figure.data}


def points(trace: Any) -> np.ndarray:
    return np.stack([getattr(trace, x) for x in "xyz" if getattr(trace, x, None) is not None], -1)


def tiles(study: Study) -> dict[str, tuple[str, str]]:
    section = sections.program(study)
    assert section is not None
    ((_, found),) = section.tiles
    return {x.label: (x.value, x.note) for x in found}


def test_the_program_stands_between_overview_and_path(study: Study) -> None:
    page = render_report(study)
    keys = "overview program paths joint-space speed bindings accelerations contour-error".split()
    places = [page.index(f'<section id="{key}">') for key in keys]
    assert places == sorted(places)
    header = page[page.index("<header>") : page.index("</header>")]
    assert re.search(r"2 contours,\s+0.2114 m of path", header)
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=", page)


def test_a_program_in_space_has_all_its_sections(in_space: Study) -> None:
    page = render_report(in_space)
    keys = "overview program paths speed bindings joints torques contour-error".split()
    places = [page.index(f'<section id="{key}">') for key in keys]
    assert places == sorted(places)


def test_tiles_are_the_trajectorys_and_the_evaluations(study: Study) -> None:
    (result,) = study.runs.values()
    spans = result.trajectory.spans
    times = {k: sum(x.t[1] - x.t[0] for x in spans if x.kind == k) for k in ("contour", "rapid")}
    found = tiles(study)
    assert found["contours"] == ("2", "0 closed, 1 layer")
    assert found["time at work"][0] == f"{times['contour']:.3f} s"
    assert found["time of rapids"] == (f"{times['rapid']:.3f} s", "2 rapids; 1 dwell, 0.5 s")
    assert found["events"] == ("4", "spindle")
    assert result.explanation is not None and result.explanation.assigned_length is not None
    assert found["at the assigned velocity"][0] == f"{result.explanation.assigned_length:.0%}"


def test_speed_in_the_overview_is_that_on_contours(study: Study) -> None:
    (result,) = study.runs.values()
    ((_, found),) = sections.overview(study).tiles
    (tile,) = (x for x in found if x.label.startswith("tool speed"))
    assert tile.value == f"{result.evaluation.speed * 1e3:.1f} mm/s"
    # Rapids are faster, and are not meant.
    assert result.execution.tool_speed.max() > 1.5 * result.evaluation.speed


def test_contours_in_a_table_with_their_errors(study: Study) -> None:
    (result,) = study.runs.values()
    section = sections.program(study)
    assert section is not None
    (table,) = section.tables
    assert [x[0] for x in table.rows] == ["1: line 4", "2: line 10"]
    for row, error, span in zip(
        table.rows, result.evaluation.contours, result.trajectory.spans[::2], strict=False
    ):
        cells = dict(zip(table.header, row, strict=True))
        assert cells["RMS error [mm]"] == f"{error.rms * 1e3:.4f}"
        assert cells["largest [mm]"] == f"{error.max * 1e3:.4f}"
        assert cells["time [s]"] == f"{span.t[1] - span.t[0]:.3f}"
    assert "leads [mm]" not in table.header and "layer" not in table.header


def test_of_many_contours_the_worst_have_a_row_and_the_others_one(tmp_path: FilePath) -> None:
    lines = ["G21 G90"]
    for i in range(MOST_ROWS + 5):
        y = 3 * i
        lines += [f"G0 X0 Y{y}", f"G1 X{4 + i % 3} F3000", f"Y{y + 2}"]
    many = study_of(tmp_path, "\n".join(lines))
    (result,) = many.runs.values()
    section = sections.program(many)
    assert section is not None
    (table,) = section.tables
    assert len(table.rows) == MOST_ROWS + 1
    assert f"the {MOST_ROWS} of {MOST_ROWS + 5} contours" in table.caption
    cells = [dict(zip(table.header, x, strict=True)) for x in table.rows]
    worst = [float(x["largest [mm]"]) for x in cells]
    assert worst == sorted(worst, reverse=True)
    assert cells[0]["largest [mm]"] == f"{result.evaluation.contour_error.max * 1e3:.4f}"
    assert cells[-1]["contour"] == "and 5 more"
    length = sum(float(x["length [mm]"]) for x in cells)
    assert length == pytest.approx(result.path.length * 1e3, abs=0.2)


def test_the_picture_shows_contours_rapids_and_events_where_they_are(study: Study) -> None:
    (result,) = study.runs.values()
    section = sections.program(study)
    assert section is not None
    found = traces(section.figures[0])
    contours = points(found["contours"]) * 1e-3
    for x in result.path.contours:  # type: ignore[union-attr]
        for s in (0.0, x.path.length / 2, x.path.length):
            distance = np.linalg.norm(contours - x.path(s), axis=1)
            assert np.nanmin(distance) < (1e-6 if s != x.path.length / 2 else 0.03)
    rapid = next(x for x in result.trajectory.spans if x.kind == "rapid")
    tool = result.execution.arm.forward(result.trajectory(np.linspace(*rapid.t, 3)))
    rapids = points(found["rapids"])
    for place in tool[[0, 2]] * 1e3:
        assert np.nanmin(np.linalg.norm(rapids - place, axis=1)) < 1e-3
    events = result.trajectory.events
    on = found["spindle on"]
    np.testing.assert_allclose(points(on) * 1e-3, [x.point for x in events[::2]], atol=1e-6)
    assert "spindle = on" in on.text[0] and f"t = {events[0].t:.4f} s" in on.text[0]
    # A start and a middle for each of both contours, pointing along them.
    arrows = found["start and direction"]
    assert len(arrows.x) == 4
    assert arrows.marker.angle[0] == pytest.approx(90)  # to the right, clockwise from up


@pytest.mark.parametrize("kind", ["study", "in_space"])
def test_contours_have_their_numbers_at_their_starts(
    kind: str, request: pytest.FixtureRequest
) -> None:
    given = request.getfixturevalue(kind)
    (result,) = given.runs.values()
    numbers = traces(sections.program(given).figures[0])["numbers"]
    starts = [x.path(0.0) * 1e3 for x in result.path.contours]
    assert list(numbers.text) == ["1", "2"]
    np.testing.assert_allclose(points(numbers), starts, rtol=1e-6)


def test_rapids_are_shaded_for_all_runs_or_for_each(study: Study) -> None:
    (one,) = study.runs.values()
    again = dataclasses.replace(one, run=dataclasses.replace(one.run, name="again"))
    *spans, last = one.trajectory.spans
    assert last.kind != "contour"
    count = 1 if last.trajectory is None else len(last.trajectory.laws)
    laws = one.trajectory.laws[:-count]
    trajectory = dataclasses.replace(one.trajectory, laws=laws, spans=tuple(spans), events=())
    other = dataclasses.replace(again, trajectory=trajectory)

    def bands(*runs: Any) -> list[Any]:
        given = Study(job=study.job, runs={x.run.name: x for x in runs})
        return list(sections.tool_speed(given).figures[0].layout.shapes)

    assert bands(one, again) == bands(one)
    # Runs that differ have strips of their own, above each other.
    found = {x.fillcolor: (x.y0, x.y1) for x in bands(one, other)}
    (low, middle), (at, high) = found.values()
    assert 0 == low < middle == at < high < 0.1
    assert [(x.x0, x.x1) for x in bands(one, other)] == [
        x.t for run in (one, other) for x in run.trajectory.spans if x.kind != "contour"
    ]


def test_rows_of_buttons_have_room_above_scenes(in_space: Study) -> None:
    for figure in (sections.program(in_space).figures[0], *sections.space(in_space).figures):
        layout = figure.layout
        if layout.scene is not None:
            # A button is 30 pixels high.
            assert max(x.pad.b for x in layout.updatemenus) + 30 <= layout.margin.t


def test_the_picture_in_space_has_the_same(in_space: Study) -> None:
    section = sections.program(in_space)
    assert section is not None
    found = traces(section.figures[0])
    assert {"contours", "rapids", "start and direction", "spindle on", "spindle off"} <= set(found)
    assert all(x.type == "scatter3d" for x in section.figures[0].data)
    (result,) = in_space.runs.values()
    start = result.path.contours[0].path(0.0) * 1e3  # type: ignore[union-attr]
    tips = points(found["start and direction"])[1::4]
    assert np.linalg.norm(tips - start, axis=1).min() < 1e-3


def test_leads_are_apart_from_what_is_at_work(led: Study) -> None:
    section = sections.program(led)
    assert section is not None
    found = traces(section.figures[0])
    lead = points(found["leads, tool off"]) * 1e-3
    length = np.linalg.norm(np.diff(lead, axis=0), axis=1)
    assert np.nansum(length) == pytest.approx(0.04, abs=1e-6)
    assert tiles(led)["length at work"][1] == "leads 40 mm"
    (table,) = section.tables
    assert dict(zip(table.header, table.rows[0], strict=True))["leads [mm]"] == "10.00, 10.00"
    # What was asked for has the leads too.
    figure = sections.paths(led).figures[0]  # type: ignore[union-attr]
    objective = points(traces(figure)["objective path"]) * 1e-3
    assert np.nanmin(np.linalg.norm(objective - lead[0], axis=1)) < 1e-6


@pytest.mark.parametrize("cell", ["pmk3s", "ur5e"])
def test_the_drawn_contours_and_the_band_of_the_kerf_are_drawn(cell: str) -> None:
    job = read_cell(cell, DRAWINGS / "plate.dxf")
    lead = Lead(length=2e-3, shape="arc", active=True)
    process = Process(kerf=1e-3, lead_in=lead, lead_out=Lead(length=2e-3, shape="arc"))
    study = run(replace_runs(dataclasses.replace(job, process=process), compensation="none"))
    section = sections.program(study)
    assert section is not None
    found = traces(section.figures[0])
    (result,) = study.runs.values()
    drawn, band = points(found["as drawn"]), points(found["kerf, 1 mm"])
    for contour in job.program.contours:
        off = np.linalg.norm(drawn - 1e3 * contour.path(0.0), axis=1)
        assert np.nanmin(off) < 1e-3
    band = band[~np.isnan(band[:, 0])]
    # Along the active lead-in, too, and not along the lead-out.
    cut = [cut_path(x.path, 0.0, x.at_work[1]) for x in result.path.contours]
    away = np.min([x.project(1e-3 * band).distance for x in cut], axis=0)
    assert away.max() == pytest.approx(0.5e-3, abs=1e-6)
    assert np.median(away) == pytest.approx(0.5e-3, abs=1e-6)
    begins = [np.linalg.norm(1e-3 * band - x(0.0), axis=1).min() for x in cut]
    assert max(begins) <= 0.501e-3
    assert "leads" in found and "leads, tool off" not in found


def test_names_from_a_file_are_escaped_and_leads_of_events_are_said(led: Study) -> None:
    (result,) = led.runs.values()
    first = next(x for x in result.trajectory.events if x.name == "<b>")
    assert said(first).startswith("&lt;b&gt; = on<br>")
    assert "50 ms before the tool is there" in said(first)
    page = render_report(led)
    assert "<b> on" not in page and "<b> = on" not in page


def test_layers_have_colours_of_their_own() -> None:
    job = read_cell("pmk3s", DRAWINGS / "gasket.dxf")
    program = job.path
    assert isinstance(program, Program)
    short = tuple(x for x in program.contours if x.path.length < 0.035)
    both = run(dataclasses.replace(job, path=dataclasses.replace(program, moves=short)))
    section = sections.program(both)
    assert section is not None
    found = traces(section.figures[0])
    assert found["layer CUT"].line.color != found["layer MARK"].line.color
    assert "layer" in section.tables[0].header


def test_moves_over_time_are_the_spans(study: Study) -> None:
    (result,) = study.runs.values()
    section = sections.program(study)
    assert section is not None
    found = traces(section.figures[1])
    for kind, label in (("contour", "contours"), ("rapid", "rapids"), ("dwell", "dwells")):
        spans = [x for x in result.trajectory.spans if x.kind == kind]
        assert list(found[label].base) == [x.t[0] for x in spans]
        ends = np.add(found[label].base, found[label].x)
        np.testing.assert_allclose(ends, [x.t[1] for x in spans])
    assert list(found["events"].x) == [x.t for x in result.trajectory.events]


def test_moves_too_short_to_be_told_apart_are_one_bar() -> None:
    spans = [Span(move=i, kind="contour", t=(i * 1.0, i + 0.9)) for i in range(10_000)]
    bars = merge_moves(spans, 10_000 / 1500)
    assert len(bars) == 1
    assert bars[0] == (0.0, 9999.9, "contours 1 to 10000<br>0.000 to 9999.900 s")
    assert len(merge_moves(spans[:3], 0.01)) == 3


def test_more_events_than_can_be_marked_are_thinned_and_that_is_said(study: Study) -> None:
    (result,) = study.runs.values()
    many = [dataclasses.replace(result.trajectory.events[0], t=float(i)) for i in range(4000)]
    marked, told = mark_events(many, True)
    assert sum(len(x.x) for x in marked) <= MOST_MARKERS
    assert told == "In the picture only every 3rd event is marked."


def test_assigned_velocities_are_steps_with_gaps(study: Study) -> None:
    (result,) = study.runs.values()
    found = assigned_speeds(result)
    planned = planned_speeds(result)
    assert found is not None
    t, s, value = found
    assert sorted({round(float(x), 6) for x in value[np.isfinite(value)]}) == [0.04, 0.05]
    assert np.isnan(value).sum() == np.isnan(t).sum() == np.isnan(s).sum() == 2
    contours = [x for x in result.trajectory.spans if x.kind == "contour"]
    assert t[0] == contours[0].t[0] and s[-2] == pytest.approx(contours[-1].s[1])
    # Rapids are in neither; the plan keeps what is assigned.
    assert np.nanmax(planned[1]) <= 0.05 * (1 + 1e-9)
    assert np.isnan(planned[0]).sum() == 1


def test_a_plan_by_another_method_has_its_assigned_velocity_too(
    study: Study, tmp_path: FilePath
) -> None:
    this = dataclasses.replace(
        study.job.runs[0], timing="mac", compensation="none", compensation_options={}, reserve=0.0
    )
    text = GCODE.replace("G3 X40 Y60 I-10 J0\n", "").replace("F2400", "")
    (result,) = study_of(tmp_path, text, runs=(this,)).runs.values()
    found, (s, speed) = assigned_speeds(result), planned_speeds(result)
    assert found is not None
    assert np.nanmax(s) == pytest.approx(result.path.length)
    assert 0.04 < np.nanmax(speed) <= 0.05 * (1 + 1e-9)
    spans = [x for x in result.trajectory.spans if x.kind == "contour"]
    ends = np.array([(*x.t, np.nan) for x in spans]).ravel()
    np.testing.assert_array_equal(found[0], ends)
    np.testing.assert_allclose(found[2][np.isfinite(found[2])], 0.05)


def test_the_speed_of_all_contours_stands_above_what_binds(study: Study) -> None:
    section = bindings(study)
    assert section is not None
    found = traces(section.figures[0])
    (result,) = study.runs.values()
    speed = found["planned tool speed"]
    assert np.nanmax(speed.x) == pytest.approx(result.path.length, rel=1e-6)
    assert "assigned velocity" in found
    shares = [float(x[2].rstrip("%")) for x in section.tables[0].rows]
    assert sum(shares) == pytest.approx(100, abs=0.5)
    # Every contour begins and ends at rest, and no edge covers the bars of short stretches.
    gaps = np.flatnonzero(np.isnan(speed.y))
    assert len(gaps) == len(result.path.contours) - 1
    rests = [speed.y[0], speed.y[-1], *speed.y[gaps - 1], *speed.y[gaps + 1]]
    np.testing.assert_allclose(rests, 0.0, atol=1e-9)
    assert {x.marker.line.width for x in section.figures[0].data if x.type == "bar"} == {0}


@given(st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=40), st.integers(1, 200))
def test_bars_of_what_binds_cover_the_length_and_are_bounded(
    widths: list[float], times: int
) -> None:
    ends = np.concatenate([[0.0], np.cumsum(widths * times)])
    found = tuple(
        Binding(limit=f"limit {i % 3}", joint=None, t=(2 * a, 2 * b), s=(a, b), share=1.0)
        for i, (a, b) in enumerate(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))
    )
    why = Explanation(bindings=found, assigned_length=None, assigned_time=None, shortfalls=())
    bars = sorted(x for of in merge_bindings(why).values() for x in of)
    assert len(bars) <= max(MOST_BARS, min(len(found), MOST_BARS))
    assert bars[0][0] == 0.0 and bars[-1][1] == ends[-1]
    for first, second in zip(bars[:-1], bars[1:], strict=True):
        assert first[1] == second[0] and first[3] == second[2]


def test_executed_contours_are_drawn_without_rapids(study: Study) -> None:
    section = sections.paths(study)
    assert section is not None
    tool = points(traces(section.figures[0])["taught"]) * 1e-3
    (result,) = study.runs.values()
    edges = np.linalg.norm(np.diff(tool, axis=0), axis=1)
    assert np.nansum(edges) == pytest.approx(result.path.length, rel=0.01)
    assert np.isnan(tool[:, 0]).sum() == 2


def test_errors_in_space_are_magnified_about_their_contours(in_space: Study) -> None:
    section = sections.space(in_space)
    assert section is not None
    figure = section.figures[0]
    (result,) = in_space.runs.values()
    larger = figure.layout.updatemenus[0].buttons[1].args[0]
    at = np.array([larger[x][0] for x in "xyz"], dtype=float).T * 1e-3
    tool = points(traces(figure)["taught"]) * 1e-3
    nearest = np.min(
        [
            np.append(x.path.project(tool[~np.isnan(tool[:, 0])]).distance, 0.0)
            for x in result.path.contours
        ],  # type: ignore[union-attr]
        axis=0,
    )
    # Samples are drawn; the largest error is between two of them, where a contour begins.
    sampled = evaluate(
        dataclasses.replace(result.execution, plant=None), result.path
    ).contour_error.max
    assert nearest.max() == pytest.approx(sampled, rel=2e-2)
    assert sampled < result.evaluation.contour_error.max < 1.03 * sampled
    moved = np.linalg.norm(at - tool, axis=1)
    assert np.nanmax(moved) == pytest.approx(9 * sampled, rel=2e-2)
    assert np.isnan(tool[:, 0]).sum() == 2


def test_sentences_beyond_what_is_read_are_counted() -> None:
    found = few([f"{i}." for i in range(MOST_SENTENCES + 7)], "warnings")
    assert len(found) == MOST_SENTENCES + 1
    assert found[-1] == "And 7 more warnings."
    assert few(["a."]) == ("a.",)


@given(
    st.lists(
        st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=2, max_size=30),
        min_size=1,
        max_size=4,
    )
)
def test_simplified_curves_stay_within_what_is_not_seen(
    curves: list[list[tuple[float, float]]],
) -> None:
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


def test_a_spiral_of_any_length_is_drawn_in_bounded_points_that_fill_it() -> None:
    turns = np.linspace(0, 400 * np.pi, 150_000)
    spiral = Path.polyline(np.stack([turns * np.cos(turns), turns * np.sin(turns)], axis=1))
    found = outline_points(Program.of(spiral))
    assert len(found) <= MOST_DRAWN + 3
    inner, outer = (np.linalg.norm(found[:-1], axis=1) < x for x in (628.0, 1300.0))
    assert outer.all() and 0.2 < inner.mean() < 0.8


def test_a_long_program_has_a_small_report(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    from plotly.offline import get_plotlyjs

    monkeypatch.setattr(sys.modules[bindings.__module__], "MOST_BARS", 50)
    lines = ["G21 G90 G64 P0.2", "G0 X0 Y0", "M3"]
    for row in range(24):
        for i in range(1, 101):
            x = i if row % 2 == 0 else 100 - i
            lines.append(f"G1 X{x} Y{row + 0.2 * (i % 2):g} F6000")
    long = study_of(tmp_path, "\n".join(lines))
    page = render_report(long)
    assert len(page) - len(get_plotlyjs()) < 1.5e6
    section = bindings(long)
    assert section is not None
    bars = sum(len(x.x) for x in section.figures[0].data if x.type == "bar")
    (result,) = long.runs.values()
    assert result.explanation is not None
    assert bars <= 50 < len(result.explanation.bindings)
    assert any("the strip shows the longest" in x for x in section.notes)


def test_a_contour_made_by_hand_with_an_event_of_text_has_a_report(study: Study) -> None:
    path = Path.polyline([(0.30, 0.15), (0.36, 0.15)])
    event = Event(name="gas", value="N2 & O2", s=0.02)
    program = Program(moves=(Contour(path=path, events=(event,)),))
    section = sections.program(run(dataclasses.replace(study.job, path=program)))
    assert section is not None
    assert "N2 &amp; O2" in traces(section.figures[0])["gas set"].text[0]


@pytest.mark.parametrize(
    "name, cell, path",
    [
        ("gasket.dxf", "pmk3s", {}),
        ("lettering.svg", "pmk3s", {}),
        ("pocket.ngc", "ur5e", {}),
        ("pocket.ngc", "pmk3s", {"flat": True}),
        ("gasket.dxf", DRAWINGS / "laser.yaml", {"names": ["handle 33", "handle 38"]}),
    ],
)
def test_a_sample_drawing_runs_to_a_report(
    name: str, cell: str | FilePath, path: dict[str, Any]
) -> None:
    done = run(read_cell(cell, DRAWINGS / name, path=path))
    page = render_report(done)
    assert '<section id="program">' in page and name in page
    (result,) = done.runs.values()
    assert result.evaluation.contour_error.max < 1e-4
    # The ports of the gasket are slower than assigned from where they begin, its holes are too
    # small for it on the PMK-3s, and the arcs of the pocket have three decimals.
    known = ("handle 38", "handle 39", "most of all contour handle 36", ": Mended ")
    assert all(any(part in x for part in known) for x in result.warnings)
    assert any(": Mended " in x for x in result.warnings) == (name == "pocket.ngc")


def test_the_sample_drawings_are_what_their_script_writes(tmp_path: FilePath) -> None:
    runpy.run_path(str(DRAWINGS / "make.py"))["main"](tmp_path)
    assert {x.name for x in tmp_path.iterdir()} == {
        "plate.dxf",
        "gasket.dxf",
        "lettering.svg",
        "pocket.ngc",
    }
    for made in sorted(tmp_path.iterdir()):
        shipped = read_path(DRAWINGS / made.name)
        again = read_path(made)
        assert [x.layer for x in again.contours] == [x.layer for x in shipped.contours]
        for one, other in zip(again.contours, shipped.contours, strict=True):
            np.testing.assert_allclose(one.path.vertices, other.path.vertices, atol=1e-12)
            np.testing.assert_allclose(one.path.lengths, other.path.lengths, atol=1e-12)
        if made.suffix != ".dxf":  # whose bytes depend on the version of ezdxf
            assert made.read_bytes() == (DRAWINGS / made.name).read_bytes()


def test_a_single_path_shows_the_velocities_of_its_segments(study: Study) -> None:
    lines = [((0.30, 0.15), (0.33, 0.15), 0.02), ((0.33, 0.15), (0.36, 0.15), 0.03)]
    path = Path.from_segments(
        [Line(start=a, end=b, demand=Demand(speed=speed)) for a, b, speed in lines]
    )
    job = dataclasses.replace(study.job, path=path, process=Process())
    found = run(job)
    assert sections.program(found) is None
    section = sections.tool_speed(found)
    assigned = traces(section.figures[0])["assigned velocity"]
    assert sorted(set(np.round(assigned.y, 4))) == [20.0, 30.0]
    assert "rapids" not in section.text
