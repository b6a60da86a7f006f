"""What results print in a terminal, and their `repr`; every result has a form of its own."""

import inspect
import re
from pathlib import Path as FilePath
from types import SimpleNamespace

import numpy as np
from tests.corner_job import CORNER_JOB

import armcontour as ac
from armcontour._describing import MOST_LINES, WIDTH, brief, digits, extremes, line_up
from armcontour.clearance.clearance import PairClearance
from armcontour.geometry.shaped import Outcome
from armcontour.identification.bodies.results import RobotJoint
from armcontour.identification.results import Estimate, JointIdentification
from armcontour.io import parse_job
from armcontour.jobs.study import teach
from armcontour.placement.judging import Verdict
from armcontour.placement.placement import Place
from armcontour.robustness.monte_carlo import Spread

BEND = """
name: bend
arm: {name: ur5e, work: {position: [0.4, -0.05, 0.2]}}
path: {points: [[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.25}
servo: {kp: 25, kv: 150}
command_interval: 4 ms
runs: {fast: {}}
"""


def estimate(name, unit, value, **more):
    given = {"sd": value / 100, "low": value * 0.98, "high": value * 1.02, "determined": True}
    return Estimate(name=name, unit=unit, value=value, **given | more)


def log():
    t = np.linspace(0.0, 1.0, 251)
    q = np.column_stack([t, -t])
    return ac.Log(t=t, command=q, measured=q, source="robot.csv")


def computed():
    """Results of a job, each with lines that `print` shows of it."""
    job = parse_job(CORNER_JOB)
    study = ac.run(job)
    x = study.runs["only"]
    certificate = ac.certify(job)
    check = ac.check(x.trajectory, job.arm, x.run.limits)
    return [
        (certificate, "contour error at most 0.004192 mm", "command interval 0.0001347 mm",
         "rounding of corners 2 mm", "left 0.09581 mm of 0.1 mm", "saturated 24.4%, 31.9%"),
        (certificate.worst, "of it servo 0.004057 mm"),
        (check, "joint acceleration 1.0000 0.72 0.72 rad/s² 0.574 s 2 kept",
         "centripetal acceleration 1.0000 0.09 0.09 m/s² 1.332 s kept",
         "speed 0.6572 0.098587 0.15 m/s 0.574 s kept"),
        (check.worst, "joint acceleration of joint 2: 1.0000 of the limit, "
         "0.72 of 0.72 rad/s² at t = 0.574 s, kept"),
        (x.evaluation.contour_error, "Error profile: RMS 1.807e-06, largest 4.192e-06 "
         "at t = 1.076 s, s = 0.05609 m (m or rad)"),
        (x.evaluation, "Evaluation: 2.1855 s of motion, at rest after 2.1930 s",
         "tracking error 0.6847 mm RMS, 1.301 mm largest (t = 0.581 s, s = 0.02782 m)",
         "tool speed 97.47 mm/s largest, 44.79 mm/s mean, 0.6498 of what is assigned",
         "joint demand / limit 1.0393 (joint 2)", "joints fully used 74.5% of the time"),
        (x.execution, "joint 1 -0.1812 to 0.0593 0.3967 0.72 654.2 ms",
         "Execution of PMK-3s: t = 0.0000 to 2.6800 s, 2681 samples every 1 ms"),
        (x.explanation, "joint 2 acceleration 1.0644 s 48.7%"),
        (x.joint_path, "Joint path: 0.09793 m, 2 joints, 29 intervals"),
        (x.path.path, "largest corner error 2 mm", "rounded 1 corner"),
        (teach(job)["only"], "Run only: 2.1855 s"),
        (x, "Run only: 2.1855 s, at rest after 2.1930 s"),
        (study, "only 2.1855 s 0.001807 mm 0.004192 mm 1.0393"),
        (x.taught, "joint 2 1.5751 to 1.9671 rad"),
        (x.trajectory, "Trajectory: 2.1855 s, 2 joints"),
        *learned(x.taught),
    ]  # fmt: skip


def learned(x):
    taught = {"period": x.period, "q": x.q, "trajectory": x.trajectory, "method": "learned"}
    one, two = np.zeros((9, 2)), np.array([1e-4, 2e-4])
    first, second = (
        ac.LearnedRun(
            q=one, error=one, noise=two / 100, loop_noise=two / 100, joint_rms=two,
            joint_max=2 * two, tool_rms=2 * rms, tool_max=5 * rms, contour_rms=rms,
            contour_max=3 * rms, predicted=rms,
        )
        for rms in (1e-4, 2e-5)
    )  # fmt: skip
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    told = {"servo": servo, "predicted": 5e-6, "noise": 2e-6, "reason": "why"}
    return [
        (first, "contour error 0.1 mm RMS, 0.3 mm largest", "joints, RMS 0.1 0.2 mrad",
         "off the plan 0.2 mm RMS, 0.5 mm largest", "noise 0.001 0.002 mrad"),
        (ac.Lesson(**taught, runs=(first, second), **told), "RMS errors 0.1 0.02 mm",
         "Lesson of 2 runs: 608 set-points every 4 ms", "best run run 2, 0.02 mm",
         "next run 0.005 mm expected", "does not repeat 0.002 mm, 1% of the square"),
    ]  # fmt: skip


def identified():
    n, arm = np.zeros(1000), ac.load_arm("pmk3s")
    open_end = {"sd": np.nan, "low": 3.5, "high": np.inf, "determined": False}
    late = estimate("dead_time", "s", 0.004)
    servo = JointIdentification(
        name="joint 1", order="second", kp=estimate("kp", "1/s", 25.0),
        kv=estimate("kv", "1/s", 150.0), dead_time=late, start="rest", t=n, simulated=n,
        residuals=n, acceleration=estimate("acceleration", "rad/s²", np.nan, **open_end),
        noise=1e-5, rms=1.25e-5, r_squared=0.9999, whiteness=0.5, bic={}, rms_of={},
        largest_demand=1.0, saturated_time=0.0,
    )  # fmt: skip
    values = {"kp": 25.0, "kv": 150.0, "viscous": 8.0, "coulomb": 6.0}
    found = {x: estimate(x, "", y) for x, y in values.items()}
    fit = {"armature": None, "rms": 1e-5, "explained": 0.99, "whiteness": 0.5}
    robot = ac.RobotIdentification(
        nominal=arm, gravity="loaded", interpolation="linear",
        joints=tuple(RobotJoint(name=f"joint {k}", **found, **fit) for k in (1, 2)),
        payload_mass=estimate("payload_mass", "kg", 1.5),
        payload_center=tuple(estimate(f"payload_center {x}", "m", 0.1) for x in "xyz"),
        armature=estimate("armature", "", 1.1), dead_time=late, arm=arm, model=None, fit=None,
        fitted=(SimpleNamespace(log=SimpleNamespace(source="a.csv")),),
        gains=ac.ServoModel(kp=25.0, kv=150.0), gains_known=True,
    )  # fmt: skip
    return [
        (servo, "residuals 0.0125 mrad RMS, white"),
        (ac.Identification(log=log(), interpolation="linear", joints=(servo, servo)),
         "joint 1 25 ±0.25 1/s 150 ±1.5 1/s 4 ±0.04 ms above 3.5 rad/s² 0.0125 mrad"),
        (robot, "payload 1.5 ±0.015 kg, at (0.1 ±0.001 m, 0.1 ±0.001 m, 0.1 ±0.001 m)",
         "joint 1 kp 25 ±0.25, kv 150 ±1.5, viscous 8 ±0.08, coulomb 6 ±0.06"),
    ]  # fmt: skip


class Jobs(list):
    name = "grid"


def studied():
    job = parse_job(CORNER_JOB)
    best = Place(values={"x": 0.01, "yaw": np.pi / 2}, verdict=Verdict(bound=1.4, duration=1.5))
    placement = ac.Placement(
        job=job, run=job.runs[0], axes=(), moves=None, objective="cycle", best=best, refined=best,
        verdicts=(best.verdict, Verdict(bound=1.6), Verdict(refusal="reach")),
        own=Verdict(refusal="reach"),
    )  # fmt: skip
    counts, errors = {"done": 300, "refused": 80}, {"Unreachable": 80}
    batch = ac.Batch(plan=Jobs(range(400)), folder=FilePath("out"), counts=counts, errors=errors)
    tally = ac.Tally(
        total=400, done=300, before=100, seconds=20.0, workers="2 processes",
        statuses={"done": 190, "refused": 10}, errors={"Unreachable": 10},
    )  # fmt: skip
    n, two = np.arange(1.0, 101.0), np.zeros((100, 2))
    spread = Spread(
        max=n * 1e-6, rms=n * 1e-7, until=n, saturated=0 * n, demand_ratio=n / 100, kp=two,
        kv=None, dead_time=two, payload=0 * n, seed=7, names=("kp of joint 1", "payload"),
        deviations=np.column_stack([n / 1e3, -n / 1e3]), nominal_max=1e-6, nominal_rms=1e-7,
    )  # fmt: skip
    return [
        (placement, "best place x 10 mm, yaw 90°: 1.5000 s", "refused 1 by reach"),
        (batch, "done 300", "refused 80", "without a result 20", "error Unreachable 80"),
        (tally, "rate 10 jobs/s, 10 s left", "results 190 done, 10 refused"),
        (spread, "contour error 0.1 mm largest of all", "in 95 % of them at most 0.096 mm",
         "worst robot kp of joint 1 +0.1, payload -0.1"),
    ]  # fmt: skip


def clearance(high, **more):
    given = {"kind": "environment", "margin": 0.01, "t": 1.25, "points": np.zeros((2, 3))}
    near = {"first": "forearm", "second": "table", "high": high, "low": high - 1e-4}
    far = {"first": "tool", "second": "vice", "high": 0.5, "low": 0.5 - 1e-4}
    pairs = (PairClearance(**given | near | more), PairClearance(**given | far))
    return ac.Clearance(pairs=pairs)


def described():
    square = ac.Path.polyline([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1], [0, 0]])
    line = ac.Path.polyline([[0, 0], [0.1, 0]])
    contours = ac.Contour(path=square, layer="CUT"), ac.Contour(path=line, layer="MARK")
    moves = (contours[0], ac.Dwell(duration=0.5), contours[1])
    outcome = Outcome(start="arcs", durations={"arcs": 1.5, "stops": 2.0, "shaped": 1.25})
    given = {"places": [[0.0, 0.0], [0.1, 0.1]], "tolerance": 2e-3, "outcome": outcome}
    slow = ac.Demand(speed=0.05)
    path = ac.Path.polyline([[0, 0, 0], [0.1, 0, 0], [0.1, 1.9, 0]], demand=slow)
    path, arm = path.pointing([0, 0, -1]), ac.load_arm("ur5e")
    return [
        (arm, "UR5e: 6 joints, in space, with masses, with shapes"),
        (clearance(0.02), "table and forearm 20 mm 1.250 s 10 mm"),
        (clearance(0.005, first_time=1.2), "table and forearm 5 mm 1.200 s 10 mm",
         "Clearance: 1 pair too near (2 pairs, 0 not looked at)"),
        (parse_job(BEND), "run fast optimal, inverse, every 4 ms, 250 mm/s"),
        (arm.limits.replace(joint_jerk=None, speed=0.25),
         "joint_torque 150, 150, 150, 28, 28, 28 N m", "speed 0.25 m/s"),
        (ac.Limits(), "Limits: none"),
        (log(), "Log of 2 joints: 251 samples, t = 0.0000 to 1.0000 s", "usual interval 4 ms"),
        (path.orientation, "tool axis constant"),
        (path, "Path in space: 2 m, 2 segments", "to (100, 1900, 0) mm", "assigned 50 mm/s"),
        (ac.Program(moves=moves, source="part.dxf", notes=("A text was left out.",)),
         "Program in the plane: 2 contours, 0.5 m", "closed 1", "other moves 1 dwell",
         "contours by layer CUT 1, MARK 1", "lengths 100 mm to 400 mm"),
        (ac.Recording(t=log().t, q=log().measured),
         "Recording: 251 samples, t = 0.0000 to 1.0000 s"),
        (ac.ShapedPath(segments=line.segments, objective=line, **given),
         "least durations arcs 1.5 s, stops 2 s, shaped 1.25 s"),
    ]  # fmt: skip


NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def alike(found, golden):
    """The same words; numbers differ by a unit of their last digit at most."""
    if " ".join(NUMBER.sub("#", found).split()) != NUMBER.sub("#", golden):
        return False
    for a, b in zip(NUMBER.findall(found), NUMBER.findall(golden), strict=True):
        mantissa, _, power = b.partition("e")
        last = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
        if abs(float(a) - float(b)) > 1.01 * last:
            return False
    return True


def test_results_print_what_a_person_can_read():
    faults, names = [], set()
    for found, *expected in (*computed(), *identified(), *studied(), *described()):
        name, lines = type(found).__name__, str(found).splitlines()
        names |= {x.__name__ for x in type(found).__mro__}
        faults += [(name, x, lines) for x in expected if not any(alike(y, x) for y in lines)]
        if len(lines) > MOST_LINES + 2 or max(map(len, lines)) >= 100:
            faults.append((name, "too long", lines))
        # In a log, or among other values, it is one line without pages of numbers.
        text = repr(found)
        if "\n" in text or len(text) >= 1000 or name not in text:
            faults.append((name, "repr", text))
    assert faults == []
    # Every result of a public function, what results hold, and what a user may be given besides.
    results = {"LimitUse", "LearnedRun", "Recording", "Tally", "Lesson", "ShapedPath"}
    for value in (getattr(ac, x) for x in ac.__all__):
        if inspect.isfunction(value):
            said = re.findall(r"\w+", str(inspect.signature(value).return_annotation))
            results |= {x for x in said if inspect.isclass(getattr(ac, x, None))}
    assert {"Certificate", "Path", "Study", "Identification"} <= results <= names
    own = {x: inspect.getattr_static(getattr(ac, x), "__str__") for x in results}
    assert [x for x, y in own.items() if y == object.__str__] == []


def test_samples_and_plants_are_one_line():
    planned = ac.plan(ac.JointPath.spline([[0.0], [1.0]]), limits=ac.Limits(joint_acceleration=1))
    found = repr(planned.sample(1.0))
    assert found.startswith("Samples(t=[0.0, 1.0, ") and "\n" not in found and len(found) < 300
    arm = ac.load_arm("pmk3s")
    plant = ac.ServoPlant(arm, ac.ServoModel(kp=25.0, kv=150.0))
    assert repr(plant) == f"ServoPlant({arm!r})" == "ServoPlant(PlanarTwoLink('PMK-3s', 2 joints))"


def test_lines_are_aligned_wrapped_and_harmless():
    rows = [("a", "1", "x"), ("nothing", "", ""), ("long name", "", "yy")]
    assert line_up("Title", rows, columns="><") == "Title\n  a          1  x\n  long name     yy"
    assert line_up("Title") == "Title"
    text = line_up("Title", [("name", "word " * 30)])
    first, *others = text.splitlines()[1:]
    assert all(len(x) <= WIDTH and x.startswith(" " * 8 + "word") for x in others)
    assert text.split() == ["Title", "name", *["word"] * 30]
    lines = line_up("Title", [(f"{k}", "x") for k in range(100)]).splitlines()
    assert len(lines) == MOST_LINES and lines[-2].split() == ["12", "x"] and "87" in lines[-1]
    # Texts of other people do not control the terminal.
    text = line_up("a\x1b[2J", [("b\nc", "d\x07")])
    assert text.splitlines() == ["a\\x1b[2J", "  b\\nc  d\\x07"]


def test_numbers_are_short():
    values = {0: "0", 0.0123456: "0.01235", 12.3456: "12.35", 12345.6: "12346", 1e-7: "1e-07"}
    assert {x: digits(x) for x in values} == values
    for value, count, text in (
        (-98765.4, 4, "-98765"), (118.4, 2, "118"), (99.7, 2, "100"), (9999.7, 4, "10000"),
        (0.01234, 2, "0.012"),
    ):  # fmt: skip
        assert digits(value, count) == text
    assert extremes([]) == "" and extremes([0.002, 0.001]) == "1 mm to 2 mm"
    assert extremes([0.001, 0.001]) == "1 mm"


def test_brief_names_arrays_by_their_shapes():
    found = brief(log())
    assert found.startswith("Log(t=<251 array>, command=<251x2 array>") and "robot.csv" in found
    many = {f"run {k}": 1 for k in range(20)}
    assert "runs=<20 str>" in brief(ac.Study(job=parse_job(BEND), runs=many))
