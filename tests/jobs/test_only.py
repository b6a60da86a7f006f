"""Single contours and layers of a job are executed as in the whole job (`process.only`)."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from docs.pages import run_command
from soak import resuming

import armcontour as ac
from armcontour.files import parse_job
from armcontour.program import Lead

OUTLINE = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06), (0, 0)])
HOLE = ac.Path(segments=[ac.Arc.circle((0.03, 0.03), (0.02, 0.03))])
OPEN = ac.Path.polyline([(0.05, 0.02), (0.09, 0.05)])
SAME = 1e-9


def chosen(job: ac.Job, *only: str, **values) -> ac.Job:
    return replace(job, process=replace(job.process, only=only, **values))


def numbers(plan) -> list[int]:
    return [x.number for x in plan.objective.contours]


def compare(whole, part, joints=1e-6):
    """The part has the contours of the whole job, with their paths, joints and places."""
    ranges = whole.objective.work_ranges
    for i, contour in enumerate(part.objective.contours):
        k = numbers(whole).index(contour.number)
        same = whole.objective.contours[k]
        np.testing.assert_allclose(contour.path.vertices, same.path.vertices, atol=SAME)
        np.testing.assert_allclose(contour.at_work, same.at_work, atol=SAME)
        assert contour.events == same.events
        np.testing.assert_allclose(part.objective.work_ranges[i], ranges[k], atol=SAME)
        before = whole.trajectory.contour_spans[k]
        span = part.trajectory.contour_spans[i]
        for a, b in zip(before.t, span.t, strict=True):
            np.testing.assert_allclose(whole.trajectory(a), part.trajectory(b), atol=joints)


@pytest.mark.parametrize(
    ("name", "only", "expected"),
    [
        ("drawing", ["MARK"], [1, 2]),
        ("drawing", ["CUT-3", "1", "8"], [1, 5, 8]),
        ("drawing", ["10"], [10]),
        ("G-code", ["line 44", "1"], [1, 3]),
        ("G-code", ["2", "4"], [2, 4]),
    ],
)
def test_contours_are_executed_as_in_the_whole_job(name, only, expected):
    job, whole = resuming.whole_plan(name)
    part = resuming.plan_of(chosen(job, *only))
    # The order is that of the whole job.
    assert numbers(part) == [x for x in numbers(whole) if x in expected]
    compare(whole, part)


def test_automatic_leads_of_kept_contours_are_those_of_the_whole_job():
    job, _ = resuming.whole_plan("drawing")
    cut = {"switch": ac.program.Switch("laser"), "lead_in": Lead(shape="arc"), "kerf": 0.2e-3}
    job = replace(job, process=replace(job.process, **cut))
    whole = resuming.plan_of(job)
    part = resuming.plan_of(chosen(job, "CUT-2", "CUT-8"))
    assert len(numbers(part)) == 2
    compare(whole, part)


def test_the_waste_of_a_single_hole_is_inside_it():
    program = ac.Program(
        moves=tuple(ac.Contour(path=x, number=i) for i, x in enumerate((OUTLINE, HOLE), 1))
    )
    cut = ac.Process(kerf=2e-3, lead_in=Lead(length=4e-3, shape="arc"))
    whole = ac.prepare(program, cut)
    (hole,) = ac.prepare(program, replace(cut, only=("2",))).contours
    same = next(x for x in whole.contours if x.number == 2)
    assert np.linalg.norm(hole.path(hole.at_work[0]) - (0.02, 0.03)) == pytest.approx(9e-3)
    np.testing.assert_allclose(hole.path.vertices, same.path.vertices, atol=SAME)
    # As a drawing of its own, it would be an outline.
    alone = ac.prepare(ac.Program(moves=program.moves[1:]), cut).contours[0]
    assert np.linalg.norm(alone.path(alone.at_work[0]) - (0.02, 0.03)) == pytest.approx(11e-3)


def heights(path: ac.Path) -> np.ndarray:
    return path.vertices[:, 2]


def test_rapids_past_a_contour_that_is_left_out_stay_above_it():
    """The second pocket ends 0.5 mm below the surface, where the third one begins."""
    job, whole = resuming.whole_plan("G-code")
    top = max(heights(x.path).max() for x in whole.objective.moves if isinstance(x, ac.Rapid))
    part = resuming.plan_of(chosen(job, "1", "3")).objective
    i, k = (n for n, x in enumerate(part.moves) if isinstance(x, ac.Contour))
    way = [x.path for x in part.moves[i + 1 : k]]
    points = np.concatenate([x.vertices for x in way])
    np.testing.assert_allclose(points[0], part.moves[i].path.end, atol=SAME)
    np.testing.assert_allclose(points[-1], part.moves[k].path.start, atol=SAME)
    for a, b in zip(way[:-1], way[1:], strict=True):
        np.testing.assert_allclose(a.end, b.start, atol=SAME)
    # The tool moves sideways only at the height of the rapids.
    aside = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1) > SAME
    at_top = np.minimum(points[:-1, 2], points[1:, 2]) > top - SAME
    assert aside.any() and at_top[aside].all()
    # Before the first contour and after the last one, too.
    single = resuming.plan_of(chosen(job, "3")).objective
    rapids = [x for x in single.moves if isinstance(x, ac.Rapid)]
    assert heights(rapids[0].path)[0] == pytest.approx(top)
    assert max(heights(x.path).max() for x in rapids[1:]) == pytest.approx(top)


def values_at(moves, i) -> dict:
    return {x.name: x.value for x in moves[:i] if isinstance(x, ac.Event)}


def test_outputs_have_their_values_of_the_whole_program():
    job, whole = resuming.whole_plan("G-code")
    assert values_at(whole.objective.moves, len(whole.objective.moves))["spindle"] is False
    part = resuming.plan_of(chosen(job, "2")).objective
    (i,) = (n for n, x in enumerate(part.moves) if isinstance(x, ac.Contour))
    before = values_at(part.moves, i)
    assert before["spindle"] is True and before["spindle speed"] == 12000
    assert values_at(part.moves, len(part.moves))["spindle"] is False


def test_a_spindle_gets_its_dwell_if_its_contour_is_left_out():
    lines = [ac.Contour(path=OPEN, number=n) for n in (1, 2)]
    spindle = ac.Event("spindle", True)
    moves = (spindle, ac.Dwell(duration=2.0), lines[0], ac.Rapid(), lines[1])
    made = ac.prepare(ac.Program(moves=moves), ac.Process(only=("2",)))
    assert [type(x) for x in made.moves] == [ac.Event, ac.Dwell, ac.Contour]
    assert made.moves[1].duration == 2.0


def test_all_passes_of_an_open_contour_are_executed():
    moves = (
        ac.Contour(path=OPEN, name="seam", number=1),
        ac.Contour(path=HOLE, name="ring", number=2),
    )
    program = ac.Program(moves=moves)
    for only in ("seam", "1", "contour 1"):
        made = ac.prepare(program, ac.Process(passes=3, only=(only,)))
        assert [x.name for x in made.contours] == ["seam", "seam (2)", "seam (3)"]
    (second,) = ac.prepare(program, ac.Process(passes=3, only=("seam (2)",))).contours
    assert second.name == "seam (2)"


def test_contours_without_numbers_are_counted_in_their_order():
    program = ac.Program(moves=(ac.Contour(path=OPEN), ac.Contour(path=HOLE)))
    (made,) = ac.prepare(program, ac.Process(only=("2",))).contours
    assert made.closed


@pytest.mark.parametrize(
    ("only", "listed"),
    [
        ("CUT-33", ["mean CUT-3", "1 to 10", "MARK-1"]),
        ("MARKS", ["mean MARK", "1 to 10"]),
        ("11", ["1 to 10"]),
        ("0", ["1 to 10"]),
        ("layer CUTS", ["1 to 10"]),
    ],
)
def test_an_unknown_name_is_refused_with_the_names_that_exist(only, listed):
    job, _ = resuming.whole_plan("drawing")
    with pytest.raises(ac.InvalidInput) as refused:
        resuming.plan_of(chosen(job, "1", only))
    text = str(refused.value)
    assert repr(only) in text
    found = [text.index(x) for x in listed]
    assert found == sorted(found)


def test_a_layer_and_a_number_of_the_same_name_are_told_apart():
    moves = (
        ac.Contour(path=OPEN, number=1, layer="2"),
        ac.Contour(path=HOLE, number=2, layer="1"),
    )
    program = ac.Program(moves=moves)
    with pytest.raises(ac.InvalidInput, match="layer 1"):
        ac.prepare(program, ac.Process(only=("1",)))
    assert not ac.prepare(program, ac.Process(only=("contour 1",))).contours[0].closed
    assert ac.prepare(program, ac.Process(only=("layer 1",))).contours[0].closed


def test_resume_at_counts_in_the_whole_job():
    job, whole = resuming.whole_plan("drawing")
    ranges = whole.objective.work_ranges
    k = numbers(whole).index(5)
    place = float(ranges[k].mean())
    # In the middle of contour 5.
    rest = resuming.plan_of(chosen(job, "5", "8", resume_at=place, rejoin=1e-3))
    left = rest.objective.contours
    assert sorted(numbers(rest)) == [5, 8]
    assert left[0].path.length == pytest.approx(float(np.diff(ranges[k])[0]) / 2 + 1e-3, abs=1e-9)
    np.testing.assert_allclose(
        left[0].path.start, whole.objective.contours[k].path(place - 1e-3 - ranges[k, 0])
    )
    np.testing.assert_allclose(rest.objective.work_ranges[0], [place - 1e-3, ranges[k, 1]])
    # The place is on a contour that is left out: the next one is executed as a whole.
    later = resuming.plan_of(chosen(job, "2", "8", resume_at=place))
    assert numbers(later) == [8]
    compare(whole, later)
    with pytest.raises(ac.InvalidInput, match="nothing is left"):
        resuming.plan_of(chosen(job, "2", resume_at=place))


def test_the_configuration_of_each_contour_is_that_of_the_whole_job():
    """On the way around the base, the joints of the later contours have turned."""
    job = parse_job(resuming.PLANAR)
    base = np.array([job.arm.base, 0.0])

    def arc(begin: float, end: float) -> ac.Contour:
        angles = np.radians(np.linspace(begin, end, 30))
        points = base + 0.35 * np.column_stack([np.cos(angles), np.sin(angles)])
        return ac.Contour(path=ac.Path.polyline(points))

    arcs = tuple(arc(x, x + 100) for x in (30, 130, 230))
    job = replace(job, path=ac.Program(moves=arcs), configuration="positive")
    whole = resuming.plan_of(job)
    part = resuming.plan_of(chosen(job, "1", "3"))
    for i, k in ((0, 0), (1, 2)):
        a = whole.trajectory(whole.trajectory.contour_spans[k].t[0])
        b = part.trajectory(part.trajectory.contour_spans[i].t[0])
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_a_contour_is_executed_though_the_whole_job_cannot_be():
    job = parse_job(resuming.PLANAR)
    far = ac.Contour(path=ac.Path.polyline([(2.0, 2.0), (2.1, 2.0)]))
    job = replace(job, path=ac.Program(moves=(job.program.contours[0], far)))
    part = resuming.plan_of(chosen(job, "1"))
    assert len(part.objective.contours) == 1
    assert any("whole job has no plan" in x for x in part.warnings)


def test_the_option_and_the_key_execute_the_same_contours(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    drawing = str(resuming.DRAWINGS / "gasket.dxf")
    begin = ["run", drawing, "--cell", "ur5e"]
    code, printed, errors = run_command([*begin, "--out", "a", "--only", "MARK, 5"])
    assert code == 0, errors
    key = "process.only=[MARK, 5]"
    code, _, errors = run_command([*begin, "--out", "b", "--set", key])
    assert code == 0, errors
    both = [json.loads(Path(x, "summary.json").read_text()) for x in "ab"]
    moves = [next(iter(x["runs"].values()))["moves"] for x in both]
    names = [x["name"] for x in moves[0] if x["kind"] == "contour"]
    assert sorted(names) == ["CUT-3", "MARK-1", "MARK-2"]
    assert moves[0] == moves[1]
    code, _, errors = run_command([*begin, "--out", "c", "--only", "MARKS"])
    assert code == 2 and "'MARKS'" in errors
