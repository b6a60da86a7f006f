"""Calls that users guess work, or the error states the right form."""

from __future__ import annotations

import re
from operator import methodcaller
from pathlib import Path

import numpy as np
import pytest
from tests.public_names import PUBLIC

import armcontour as ac
from armcontour.core.guesses import FORMS, MADE_BY, SAME

DRAWING = Path(__file__).parents[1] / "examples" / "drawings" / "gasket.dxf"
ARM = ac.load_arm("pmk3s")
LIMITS = ARM.limits.replace(speed=0.1)
CORNER = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20), (0.33, 0.23)])
ROUNDED = ac.round_corners(CORNER, 1e-3)
SERVO = ac.ServoModel(25.0, 150.0)
PLANNED = ac.plan(ROUNDED, ARM, LIMITS)


def test_paths_consist_of_lines_and_all_forms_of_arcs() -> None:
    line = ac.Path.line((0.0, 0.0), (0.3, 0.4))
    arc = ac.Path.arc((0, 0), (2, 0), via=(1, 1))
    circle = ac.Path.circle((0.1, 0.2, 0.3), 0.05)
    assert line.length == pytest.approx(0.5)
    assert arc.length == pytest.approx(np.pi)
    assert circle.length == pytest.approx(0.1 * np.pi)
    assert circle.start == pytest.approx([0.15, 0.2, 0.3])
    assert circle(circle.length / 4) == pytest.approx([0.1, 0.25, 0.3])
    with pytest.raises(ac.InvalidInput, match="radius"):
        ac.Path.circle((0.1, 0.2), -0.05)


def test_paths_are_made_from_segments_and_closed_polylines() -> None:
    lines = [ac.Line((0.0, 0.0), (0.3, 0.0)), ac.Line((0.3, 0.0), (0.3, 0.4))]
    assert ac.Path(lines).length == pytest.approx(0.7)
    assert ac.Path.polyline([x.start for x in lines] + [lines[1].end], closed=True).length == 1.2


def test_arguments_accept_texts_with_units() -> None:
    limits = ac.Limits(speed="100 mm/s", joint_velocity=["90 deg/s", 1.0])  # type: ignore
    assert limits.speed == 0.1
    assert limits.joint_velocity == pytest.approx([np.pi / 2, 1.0])
    assert ac.Limits(joint_velocity=[["-1 rad/s", "90 deg/s"]]).joint_velocity[0, 0] == -1.0  # type: ignore
    assert LIMITS.replace(speed="inf").removed >= {"speed"}
    assert ac.Optimal(reserve="5 %").reserve == 0.05  # type: ignore
    assert ac.ServoModel(25.0, 150.0, dead_time="4 ms").dead_time == 4e-3  # type: ignore
    assert ac.round_corners(CORNER, "1 mm").length == ROUNDED.length
    assert len(PLANNED.sample("0.1 s").t) == len(PLANNED.sample(0.1).t)  # type: ignore
    for wrong, words in (
        ("5", "has no unit"),
        ("1 kg", "must be a quantity in m/s"),
        ("-1 m/s", "must be above zero, but is -1 m/s"),
    ):
        with pytest.raises(ac.InvalidInput, match=words):
            ac.Limits(speed=wrong)  # type: ignore


def test_a_drawing_and_a_cell_are_a_job() -> None:
    job = ac.read_job(DRAWING, cell="ur5e")
    assert job.arm.name == "UR5e"
    assert job.program.length == ac.read_path(DRAWING).length


def test_a_two_link_arm_has_its_first_joint_at_the_origin() -> None:
    arm = ac.PlanarTwoLink(name="own", links=(0.3, 0.2), limits=LIMITS)
    assert arm.forward([0.0, 0.0])[:2, 3] == pytest.approx([0.0, 0.5])


def test_a_trajectory_can_be_sampled_and_explained() -> None:
    sampled = PLANNED.sample(4e-3)
    for name in ("t", "q", "dq", "ddq"):
        assert np.array_equal(getattr(PLANNED, name), getattr(sampled, name))
    assert PLANNED.explain().kinds == ac.explain(PLANNED, ARM, LIMITS).kinds


def test_functions_use_the_arm_of_the_motion_by_default() -> None:
    joints = ac.JointPath.spline([[0.0, 0.0], [0.3, 0.2], [0.5, 0.1]])
    bare = ac.plan(joints, limits=ac.Limits(joint_velocity=1.0, joint_acceleration=3.0))
    assert ac.check(PLANNED).verdict == ac.check(PLANNED, ARM).verdict
    assert ac.check_clearance(PLANNED).satisfied
    for use in (ac.check, ac.explain, ac.check_clearance):
        with pytest.raises(ac.InvalidInput, match="no arm"):
            use(bare)


def test_servos_execute_set_points_of_a_planned_arm() -> None:
    set_points = ac.compensate(PLANNED, SERVO)
    plant = ac.ServoPlant(ARM, SERVO)
    assert np.array_equal(ac.simulate(set_points, SERVO).q, ac.simulate(set_points, plant).q)


def test_an_export_format_can_be_named(tmp_path: Path) -> None:
    set_points = ac.compensate(PLANNED, SERVO)
    ac.export(set_points, tmp_path / "named.txt", "csv")
    ac.export(set_points, tmp_path / "ending.csv")
    assert (tmp_path / "named.txt").read_text() == (tmp_path / "ending.csv").read_text()


def test_the_distance_from_the_drawing_covers_both_directions() -> None:
    executed = ac.simulate(ac.compensate(PLANNED, SERVO), ac.ServoPlant(ARM, SERVO))
    evaluated = ac.evaluate(executed, ROUNDED, objective=CORNER)
    assert evaluated.objective_error and evaluated.objective_coverage_error
    both = evaluated.objective_error.max, evaluated.objective_coverage_error.max
    assert evaluated.off_drawing == max(both)
    assert both[0] < 0.8 * both[1]
    assert ac.evaluate(executed, ROUNDED).off_drawing is None


def test_a_path_is_certified_with_an_arm_a_servo_and_a_goal() -> None:
    goal = ac.CertificateGoal(tolerance=1e-3)
    run = ac.Run(name="only", limits=LIMITS, rounding=ac.Rounding(tolerance=1e-3))
    job = ac.Job(name="corner", arm=ARM, path=CORNER, servo=SERVO, runs=(run,))
    certificate = ac.certify(CORNER, ARM, SERVO, LIMITS, goal=goal)
    assert certificate.trajectory.duration == ac.certify(job, goal=goal).trajectory.duration
    with pytest.raises(ac.InvalidInput, match="an arm, a servo and a goal"):
        ac.certify(CORNER, ARM, goal=goal)
    with pytest.raises(ac.InvalidInput, match="Remove these arguments"):
        ac.certify(job, ARM, goal=goal)


@pytest.mark.parametrize(
    ("call", "form"),
    [
        (lambda: ac.plan(ROUNDED, ARM, speed=0.1), "limits=Limits(speed=...)"),
        (lambda: ac.plan(ROUNDED, ARM, reserve=0.1), "options=Optimal(reserve=...)"),
        (lambda: ac.compensate(PLANNED, kp=25.0), "servo=ServoModel(kp=...)"),
        (lambda: ac.plan(ROUNDED, ARM, method="paper"), "options=Optimal()"),
        (lambda: ac.compensate(PLANNED, SERVO, method="inverse"), "options=Inverse()"),
        (lambda: ac.ServoModel(25.0, 150.0, delay=0.004), "did you mean dead_time?"),
        (lambda: ac.PlanarTwoLink(0.3, 0.2), "PlanarTwoLink(name=..., links=..., limits=...)"),
        (
            lambda: ac.certify(CORNER, ARM, SERVO, tolerance=1e-3),
            "goal=CertificateGoal(tolerance=...)",
        ),
    ],
)
def test_wrong_arguments_are_refused_with_the_accepted_form(call: object, form: str) -> None:
    with pytest.raises(ac.InvalidInput, match=re.escape(form)):
        call()  # type: ignore[operator]


URDF = Path(__file__).parent / "files" / "robots" / "data" / "robot.urdf"
LIMITS_FILE = DRAWING.parent / "ur5e_joint_limits.yaml"
UR5E = ac.load_arm("ur5e")
CORNERS = [(0.4, -0.05, 0.2), (0.5, -0.05, 0.2), (0.5, 0.05, 0.2)]
IN_SPACE = ac.Path.polyline(CORNERS).pointing((0, 0, -1))


def test_an_arm_is_named_wherever_one_is_an_argument() -> None:
    limits = UR5E.limits.replace(speed=0.1)
    planned = ac.plan(IN_SPACE, "ur5e", limits)
    assert planned.duration == ac.plan(IN_SPACE, UR5E, limits).duration
    assert ac.trace(IN_SPACE, "ur5e").dof == 6  # type: ignore[arg-type]
    assert ac.explain(planned, "ur5e").kinds == ac.explain(planned, UR5E).kinds
    servo = ac.ServoPlant("ur5e", SERVO)  # type: ignore[arg-type]
    set_points = ac.compensate(planned, SERVO)
    expected = ac.simulate(set_points, ac.ServoPlant(UR5E, SERVO)).q
    assert np.array_equal(ac.simulate(set_points, servo).q, expected)
    assert ac.check(planned, "ur5e").verdict == ac.check(planned, UR5E).verdict  # type: ignore[arg-type]
    for use in (ac.plan, ac.trace):
        with pytest.raises(ac.InvalidInput, match="no built-in arm 'ur55'"):
            use(IN_SPACE, "ur55")  # type: ignore[operator]


def test_set_points_have_a_length() -> None:
    set_points = ac.compensate(PLANNED, SERVO)
    assert len(set_points) == len(set_points.q) == len(set_points.t)


def test_options_of_an_arm_are_arguments() -> None:
    arm = ac.load_arm(URDF, base="base_link", tip="tcp")
    assert arm.dof == 4
    with pytest.raises(ac.InvalidInput, match="tilt requires part"):
        ac.load_arm(URDF, base="base_link", tip="tcp", tilt=0.1)


def names() -> dict[str, object]:
    """Names that the written forms contain, with a value each."""
    planned = ac.plan(IN_SPACE, UR5E, UR5E.limits.replace(speed=0.1))
    set_points = ac.compensate(planned, SERVO)
    plant = ac.ServoPlant(UR5E, SERVO)
    executed = ac.simulate(set_points, plant)
    evaluation = ac.evaluate(executed, IN_SPACE)
    return {
        "ac": ac,
        "np": np,
        "path": IN_SPACE,
        "other": IN_SPACE.reversed(),
        "points": CORNERS,
        "point": CORNERS[0],
        "start": CORNERS[0],
        "via": CORNERS[1],
        "end": CORNERS[2],
        "arm": UR5E,
        "name": "ur5e",
        "planned": planned,
        "data": planned,
        "set_points": set_points,
        "executed": executed,
        "plant": plant,
        "servo": SERVO,
        "program": ac.read_path(DRAWING),
        "evaluation": evaluation,
        "error": evaluation.contour_error,
        "result": planned,
        "frame": ac.Frame((0.1, 0.0, 0.0)),
        "rotation": np.diag([1.0, -1.0, -1.0]),
        "pose": UR5E.forward([0.1, -1.2, 1.5, -1.8, -1.5, 0.2]),
        "q": np.array([0.1, -1.2, 1.5, -1.8, -1.5, 0.2]),
        "angles": (0.0, 0.0, 0.1),
        "limits_file": LIMITS_FILE,
        "layers": ["CUT"],
        "edges": None,
        **dict.fromkeys(("x", "y", "z", "s", "t"), 0.05),
        **{"radius": 1e-3, "width": 2e-3, "factor": 0.5, "mass": 1.0, "kp": 25, "kv": 150},
        **{"speed": 0.1, "velocity": 1.0, "acceleration": 5.0, "jerk": 500.0, "cycle": 4e-3},
    }


def test_every_form_that_messages_write_is_valid(tmp_path: Path) -> None:
    namespace = names()
    forms = {x for table in FORMS.values() for x in table.values()} | set(MADE_BY.values())
    # Other tests identify logs, and read jobs and logs.
    skipped = {x for x in forms if re.match(r"ac\.(identify\(logs|read_job\(file|read_log)", x)}
    assert len(skipped) == 5
    for form in sorted(forms - skipped):
        reads = "read_path(file" in form or "read_job(file" in form
        namespace["file"] = DRAWING if reads else tmp_path / "out.csv"
        eval(form, namespace)


def test_guesses_name_attributes_that_exist() -> None:
    classes = [x for x in PUBLIC.values() if isinstance(x, type)]
    known = {name for x in classes for name in dir(x)}
    known |= {name for x in (ac.load_arm, ac.read_path) for name in x.__wrapped__.__annotations__}
    wrong = {guess: x for guess, right in SAME.items() for x in right if x not in known}
    assert not wrong
    owners = {x.__name__ for x in classes} | {*ac.__all__, "armcontour", "Path.arc"}
    assert not set(FORMS) - owners - {"Path.polyline", "ErrorProfile", "Identification", "Picture"}
    # A guess that is right would never be explained.
    for x in classes:
        assert not {k for k in FORMS.get(x.__name__, ()) if hasattr(x, k)}


GUESSES = [
    (lambda: ac.Tool, "ac.load_arm(name, tool=ac.Frame((x, y, z)))"),
    (lambda: ac.load("ur5e"), "ac.load_arm(name)"),
    (lambda: ac.read_dxf("a.dxf"), "ac.read_path(file)"),
    (lambda: ac.time_optimal(ROUNDED), "ac.plan(path, arm)"),
    (lambda: ac.Limit, "did you mean Limits?"),
    (lambda: ac.Path.from_csv("a.csv"), "ac.read_path(file)"),
    (lambda: ac.Path.from_dxf("a.dxf"), "ac.read_path(file)"),
    (lambda: ac.Arm.from_urdf("a.urdf"), "ac.load_arm(name)"),
    (lambda: CORNER.translate((0, 0)), "path.placed((x, y, z))"),
    (lambda: CORNER.reverse(), "did you mean reversed?"),
    (lambda: CORNER.vertces, "did you mean vertices?"),
    (lambda: ROUNDED.points, "path.vertices"),
    (lambda: CORNER.plan(ARM), "ac.plan(...)"),
    (lambda: CORNER.zzz, "it has arc"),
    (lambda: ac.read_path(DRAWING, unit="mm"), "ac.ReadOptions(units='mm')"),
    (lambda: ac.load_arm("ur5e", acceleration=10.0), "joint_limits=limits_file"),
    (lambda: ac.trace(ROUNDED, ARM).joints, "ac.trace(path, arm)(s)"),
    (lambda: PLANNED.positions, "did you mean q?"),
    (lambda: PLANNED.velocities, "did you mean dq?"),
    (lambda: PLANNED.to_csv("a"), "ac.export(planned, file)"),
    (lambda: ARM.fk([0, 0]), "did you mean forward?"),
    (lambda: ARM.inverse_kinematics((0, 0)), "did you mean inverse?"),
    (lambda: LIMITS.velocity, "did you mean joint_velocity?"),
    (lambda: LIMITS.acceleration, "did you mean joint_acceleration?"),
    (lambda: ac.Limits(velocity=1.0), "did you mean joint_velocity?"),
    (lambda: ac.Limits(max_speed=1.0), "did you mean speed?"),
    (lambda: ac.ServoModel(Kp=25, kv=150), "did you mean kp?"),
    (lambda: ac.compensate(PLANNED, SERVO, dt=4e-3), "did you mean cycle?"),
    (lambda: ac.load_arm("a.urdf", tip_link="tool0"), "did you mean tip?"),
    (lambda: ac.round_corners(CORNER, radius=1e-3), "tolerance=radius"),
    (lambda: ac.Path([(0.0, 0.0), (1.0, 0.0)]), "Path.polyline(points)"),
    (lambda: ac.load_arm("ur5e", payload=1.5), "ac.Payload(mass)"),
    (lambda: ac.identify("log.csv"), "ac.read_log(file)"),
    (lambda: ac.run("job.yaml"), "ac.read_job(file)"),
    (lambda: PLANNED.plot().savefig("plan.png"), "planned.plot().write_html(file)"),
    (lambda: ac.read_path(DRAWING).bounds, "vertices"),
    (lambda: ac.read_path(DRAWING, tolerance=1e-3), "ac.round_corners(path, tolerance=radius)"),
    (lambda: PLANNED.limited_by, "planned.explain()"),
    (lambda: PLANNED.summary(), "print(planned)"),
    (lambda: ac.compensate(PLANNED, SERVO).to_pandas(), "np.column_stack"),
    (lambda: ROUNDED.plot(arm=ARM), "it takes kind"),
    (lambda: ac.simulate(PLANNED, ARM), "ac.compensate(planned, servo)"),
]


@pytest.mark.parametrize(("guess", "right"), GUESSES)
def test_a_guess_is_told_its_right_form(guess: object, right: str) -> None:
    with pytest.raises((AttributeError, ac.InvalidInput)) as caught:
        guess()  # type: ignore[operator]
    assert right in str(caught.value)


def test_errors_inside_a_property_are_not_hidden() -> None:
    class Broken(ac.Path):
        @property
        def size(self) -> float:
            return self.missing_name

    with pytest.raises(AttributeError, match="missing_name"):
        _ = Broken([ac.Line((0, 0), (1, 0))]).size
    assert not hasattr(CORNER, "__array_interface__")


def test_certificates_show_picture_and_rows() -> None:
    goal = ac.CertificateGoal(tolerance=1e-3)
    certificate = ac.certify(CORNER, ARM, SERVO, LIMITS, goal=goal)
    assert "<svg" in certificate.plot().svg
    page = methodcaller("_repr_html_")(certificate)
    assert page and "<svg" in page and "<script" not in page
    times = [float(x) for x in re.findall(r"<td>([\d.]+) s</td>", page)]
    assert certificate.trajectory.duration == pytest.approx(times[0], rel=5e-3)
