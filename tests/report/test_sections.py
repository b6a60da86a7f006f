"""Sections on clearance, bodies, learning and placement: what they show is the result's."""

import dataclasses

import numpy as np
import pytest
from tests.corner_job import CORNER_JOB

import armcontour as ac
from armcontour import scene as cell
from armcontour.frames import Frame
from armcontour.io import parse_job
from armcontour.jobs import Study, run
from armcontour.jobs.learning import LearningStudy, learn_run, plan_run
from armcontour.placement import KINDS, Axis, Moves, Place, Placement, Verdict
from armcontour.report import render_learning, sections
from armcontour.report.sections import clearance, overview
from armcontour.report.sections import placement as placement_section
from armcontour.report.sections.bodies import draw_surroundings, seen_from_base
from armcontour.report.sections.learning import run_header, run_rows
from armcontour.report.sections.placement import GREYS

WORK = ", work: {position: [0.4, 0.1, 0.3], rpy: [0.3, -0.4, 1.0]}"
TILTED = f"""
name: tilted
arm: {{name: ur5e{WORK}}}
path: {{points: [[0, 0, 0], [0.05, 0, 0]], orientation: {{axis: [0, 0, -1]}}}}
limits: {{speed: 0.1}}
servo: {{kp: 25, kv: 150}}
runs: {{taught: {{}}}}
"""
OBSTACLES = """
scene:
  halfspaces: [{name: table}]
  boxes: [{name: block, fixed_to: part, at: [0.1, 0, 0], size: [0.02, 0.02, 0.02]}]
"""
SEAM = """
name: seam
arm: ur5e
path: {points: [[0.40, 0, 0.1], [0.45, 0, 0.1]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.1}
servo: {kp: 25, kv: 150}
command_interval: 0.004
runs: {taught: {timing: {method: optimal}, compensation: {method: inverse}}}
"""
JERKY = """
name: jerk
arm: pmk3s
path: {points: [[0.35, 0.10], [0.36, 0.12]]}
limits: {joint_acceleration: 0.72 rad/s^2, joint_jerk: 7.2 rad/s^3}
servo: {kp: 25, kv: 150}
runs: {plain: {timing: {method: optimal}, compensation: {method: none}}}
"""
Q = np.array([[0.3, -1.2, 1.4, -1.0, -1.5, 0.2]])
PREDICTED = "RMS that was predicted"
# Along x, y and yaw, 2 places each.
VERDICTS = (
    Verdict(duration=2.0, bound=1.9, singular=0.3), Verdict(bound=2.5, singular=0.2),
    Verdict(refusal="reach"), Verdict(bound=2.2, singular=0.4),
    Verdict(refusal="reach"), Verdict(refusal="clearance"),
    Verdict(duration=3.0, bound=2.0, singular=0.1), Verdict(refusal="limits"),
)  # fmt: skip


def traces(figure):
    return {x.name: x for x in figure.data}


def test_bodies_stand_in_the_coordinates_of_the_arms_base():
    job = parse_job(TILTED + OBSTACLES)
    own = parse_job(TILTED.replace(WORK, ""))
    links = seen_from_base(job.arm, job.arm.links(Q))[0]
    np.testing.assert_allclose(links, own.arm.links(Q)[0] * 1e3, atol=1e-9)
    assert np.abs(links[0]).max() < 1e-9
    found = {trace.name: points for trace, points in draw_surroundings(job, links)}
    table, block = found["table"], found["block"]
    # The table is that of the base; its plate is larger than the arm, which stands on it.
    assert table[:, 2].max() == pytest.approx(0, abs=1e-9)
    assert np.ptp(table[:, 0]) > np.ptp(links[:, 0])
    base = job.arm.chain.base.inverse
    middle = base.position + base.rotation @ [0.1, 0, 0]
    np.testing.assert_allclose(block.mean(axis=0), middle * 1e3, atol=1e-9)
    assert found["base_link_inertia"][:, 2].min() > -5
    drawn = draw_surroundings(parse_job(TILTED), np.array([[0, 0, 9.0], [400, 90, 5]]))
    plane = {trace.name: points for trace, points in drawn}["plane of the base"]
    assert (plane[:, 2] == 0).all() and np.ptp(plane[:, :2], axis=0).tolist() == [400, 90]


def test_distances_pairs_and_the_nearest_posture_are_shown():
    plain = parse_job(SEAM, source="test")
    assert clearance(ac.run(plain)) is None or plain.arm.shapes is not None
    tetrahedron = cell.Mesh(points=[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    shapes = (
        cell.LinkShape(name="forearm", link=3, shape=cell.Capsule(radius=0.05, length=0.3)),
        cell.LinkShape(name="wrist", link=6, shape=cell.Cylinder(radius=0.04, length=0.05)),
        cell.LinkShape(name="tip", link=6, shape=cell.Sphere(radius=0.01), tool=True),
    )
    obstacles = tuple(
        cell.Obstacle(name=name, shape=shape, place=Frame(position=position))
        for name, shape, position in (
            ("floor", cell.HalfSpace(), [0, 0, -0.4]),
            ("box", cell.Box(size=[0.1, 0.1, 0.1]), [0.6, 0.3, 0]),
            ("wedge", tetrahedron, [0.6, -0.4, 0]),
        )
    )
    arm = plain.arm.with_shapes(cell.ArmShapes(shapes=shapes))
    scene = cell.Scene(obstacles=obstacles)
    section = clearance(ac.run(dataclasses.replace(plain, arm=arm, scene=scene)))
    over_time, posture = section.figures
    assert {"links and cell, planned", "links and cell, executed"} <= set(traces(over_time))
    # The posture is that of the least distance from an obstacle, which is named with its distance.
    names = [x.name for x in posture.data if x.type == "scatter3d"]
    assert any(x.split(", ")[1].split(":")[0] in ("floor", "box", "wedge") for x in names[1:])
    bodies = {x.name for x in posture.data if x.type == "mesh3d"}
    assert bodies == {"forearm", "wrist", "tip", "floor", "box", "wedge"}
    (table,) = section.tables
    assert all(row[-2] == "kept" for row in table.rows) and len(table.rows) > 3
    assert any(x.startswith("Run taught: Clear: ") for x in section.notes)


def test_the_overview_has_the_jerk_of_joints_with_a_limit():
    study = run(parse_job(JERKY))
    result = study.runs["plain"]
    free = dataclasses.replace(result.run, limits=result.run.limits.replace(joint_jerk=None))
    other = Study(job=study.job, runs={"plain": dataclasses.replace(result, run=free)})
    with_limit, without = (
        {tile.label for _, tiles in overview(x).tiles for tile in tiles} for x in (study, other)
    )
    assert with_limit - without == {"joint jerk / limit"}


@pytest.fixture(scope="module")
def real():
    """Learned from an ideal servo: the second run is made up of the first."""
    job = parse_job(CORNER_JOB.replace("pole_placement", "none"))
    plan = plan_run(job, None)
    executed = ac.execute(plan.taught, ac.ServoPlant(job.arm, job.servo), resolution=4e-3)
    lesson = learn_run(job, plan, plan.taught, executed)
    first = lesson.runs[0]
    second = dataclasses.replace(
        first, error=first.error / 10, joint_rms=first.joint_rms / 10, contour_rms=2e-6,
        contour_max=5e-6, predicted=3e-6, source="<b>run2</b>.csv",
    )  # fmt: skip
    lesson = dataclasses.replace(
        lesson, runs=(first, second), predicted=1e-6, noise=2e-7, finished=False
    )
    return LearningStudy(job=job, plan=plan, lesson=lesson)


def test_learning_shows_errors_over_runs_joints_and_time(real):
    over_runs, joints, over_time = sections.learning(real).figures
    figure, (first, _) = traces(over_runs), real.lesson.runs
    np.testing.assert_allclose(figure["RMS"].y, [1e3 * first.contour_rms, 2e-3])
    np.testing.assert_allclose(figure["largest"].y, [1e3 * first.contour_max, 5e-3])
    predicted = figure[PREDICTED]
    assert list(predicted.x) == [2, 3]
    np.testing.assert_allclose(predicted.y, [3e-3, 1e-3])
    np.testing.assert_allclose(figure["does not repeat"].y, 2e-4, rtol=1e-6)
    for j, trace in enumerate(joints.data):
        assert trace.name == real.job.arm.joint_names[j]
        np.testing.assert_allclose(trace.y, [1e3 * x.joint_rms[j] for x in real.lesson.runs])
    before, after = over_time.data
    assert before.name.startswith("before learning: RMS")
    assert after.name == "run 2: RMS 0.002 mm, largest 0.005 mm"
    assert 0 < np.max(after.y) < np.max(before.y) / 3


def test_learning_has_a_row_for_every_run_and_the_next(real):
    rows = run_rows(real)
    assert len({len(x) for x in [*rows, run_header(real)]}) == 1
    assert [x[0] for x in rows] == ["1: the execution", "2: <b>run2</b>.csv (best)", "next"]
    assert rows[2][1:] == ["", "", "0.00100", ""]
    done = dataclasses.replace(real, lesson=dataclasses.replace(real.lesson, finished=True))
    assert len(run_rows(done)) == 2
    assert list(traces(sections.learning(done).figures[0])[PREDICTED].x) == [2]
    page = render_learning(real)
    assert 'id="learning"' in page and "from logs of its robot" in page
    assert "&lt;b&gt;run2&lt;/b&gt;.csv" in page and "<b>run2" not in page


def placed(names, shape, verdicts):
    job = parse_job(JERKY)
    values = np.linspace(0.0, 0.1, 2)
    axes = tuple(Axis(name=x, values=values[:n]) for x, n in zip(names.split(), shape, strict=True))
    best = Place(values=dict.fromkeys(names.split(), 0.0), verdict=verdicts[0])
    return Placement(
        job=job, run=job.runs[0], axes=axes, moves=Moves(anchor=np.zeros(3)), objective="cycle",
        verdicts=verdicts, best=best, refined=best, own=verdicts[0],
    )  # fmt: skip


def test_a_map_shows_the_best_over_other_axes_and_refusals_in_grey():
    assert tuple(GREYS) == KINDS
    section = placement_section(placed("x y yaw", (2, 2, 2), VERDICTS))
    assert [name for name, _ in section.choices] == ["duration", "least singular value"]
    (figure,) = section.choices[0][1]
    heat = [x for x in figure.data if x.type == "heatmap"]
    maps = {x.colorbar.title.text if x.colorbar else x.hovertemplate: x for x in heat}
    values = np.array(maps.pop("duration [s]").z, dtype=float)
    # Rows are along y.
    np.testing.assert_array_equal(values, [[2.0, np.nan], [2.2, 3.0]])
    ((words, grey),) = maps.items()
    # At x = 0.1, y = 0 both yaws are refused; the farther from the end of the list names it.
    assert "refused by clearance" in words
    np.testing.assert_array_equal(np.isfinite(np.array(grey.z, dtype=float)), [[0, 1], [0, 0]])
    assert "refused by clearance" in traces(figure)
    (singular,) = section.choices[1][1]
    (heat,) = [x for x in singular.data if x.colorbar]
    np.testing.assert_array_equal(np.array(heat.z, dtype=float), [[0.3, np.nan], [0.4, 0.1]])
    assert ("reach", "2") in section.tables[1].rows
