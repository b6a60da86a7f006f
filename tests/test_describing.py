"""What results print in a terminal, and their `repr`; every result has a form of its own."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from soak.corner_job import CORNER_JOB

import armcontour as ac
from armcontour._describing import MOST_LINES, WIDTH, brief, digits, extremes, line_up
from armcontour.certification.sweeping import SweepPoint
from armcontour.clearance.clearance import PairClearance
from armcontour.geometry.shaped import Outcome
from armcontour.identification.bodies.results import RobotJoint
from armcontour.identification.results import Estimate, JointIdentification
from armcontour.io import parse_job
from armcontour.jobs.study import RunResult, teach
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


@cache
def certificate() -> ac.Certificate:
    return ac.certify(parse_job(CORNER_JOB))


@cache
def result() -> RunResult:
    return ac.run(parse_job(CORNER_JOB)).runs["only"]


def estimate(name: str, unit: str, value: float, **more: Any) -> Estimate:
    given = {"sd": value / 100, "low": value * 0.98, "high": value * 1.02, "determined": True}
    return Estimate(name=name, unit=unit, value=value, **given | more)


def servo_joint(name: str) -> JointIdentification:
    n = np.zeros(1000)
    open_end = {"sd": np.nan, "low": 3.5, "high": np.inf, "determined": False}
    return JointIdentification(
        name=name,
        order="second",
        kp=estimate("kp", "1/s", 25.0),
        kv=estimate("kv", "1/s", 150.0),
        dead_time=estimate("dead_time", "s", 0.004),
        acceleration=estimate("acceleration", "rad/s²", np.nan, **open_end),
        start="rest",
        t=n,
        simulated=n,
        residuals=n,
        noise=1e-5,
        rms=1.25e-5,
        r_squared=0.9999,
        whiteness=0.5,
        bic={},
        rms_of={},
        largest_demand=1.0,
        saturated_time=0.0,
    )


def robot() -> ac.RobotIdentification:
    def joint(name: str) -> RobotJoint:
        values = {"kp": 25.0, "kv": 150.0, "viscous": 8.0, "coulomb": 6.0}
        found = {x: estimate(x, "", y) for x, y in values.items()}
        return RobotJoint(
            name=name, **found, armature=None, rms=1e-5, explained=0.99, whiteness=0.5
        )

    arm = ac.load_arm("pmk3s")
    return ac.RobotIdentification(
        nominal=arm,
        gravity="loaded",
        interpolation="linear",
        joints=(joint("joint 1"), joint("joint 2")),
        payload_mass=estimate("payload_mass", "kg", 1.5),
        payload_center=tuple(estimate(f"payload_center {x}", "m", 0.1) for x in "xyz"),  # type: ignore[arg-type]
        armature=estimate("armature", "", 1.1),
        dead_time=estimate("dead_time", "s", 0.004),
        arm=arm,
        fitted=(SimpleNamespace(log=SimpleNamespace(source="a.csv")),),  # type: ignore[arg-type]
        model=None,  # type: ignore[arg-type]
        fit=None,  # type: ignore[arg-type]
        gains=ac.ServoModel(kp=25.0, kv=150.0),
        gains_known=True,
    )


def log() -> ac.Log:
    t = np.linspace(0.0, 1.0, 251)
    q = np.column_stack([t, -t])
    return ac.Log(t=t, command=q, measured=q, source="robot.csv")


def learned(rms: float) -> ac.LearnedRun:
    one, two = np.zeros((9, 2)), np.array([1e-4, 2e-4])
    return ac.LearnedRun(
        q=one,
        error=one,
        noise=two / 100,
        loop_noise=two / 100,
        joint_rms=two,
        joint_max=2 * two,
        tool_rms=2 * rms,
        tool_max=5 * rms,
        contour_rms=rms,
        contour_max=3 * rms,
        predicted=rms,
    )


def taught() -> dict[str, Any]:
    x = result().taught
    return {"period": x.period, "q": x.q, "trajectory": x.trajectory, "method": "learned"}


def lesson() -> ac.Lesson:
    runs = (learned(1e-4), learned(2e-5))
    return ac.Lesson(**taught(), runs=runs, predicted=5e-6, bound=2e-5, noise=2e-6, reason="why")


def point(tolerance: float | None, **more: Any) -> SweepPoint:
    given = {"speed": 0.15, "optimum": 1.5, "duration": 1.51, "contour_error": 9e-5}
    return SweepPoint(**{**given, "refusal": None, "shape": "arc", **more}, tolerance=tolerance)


def swept() -> ac.Sweep:
    refused = {"duration": None, "contour_error": None, "refusal": "No plan holds."}
    points = (point(1e-3), point(2e-3, **refused))
    job = parse_job(CORNER_JOB)
    return ac.Sweep(job=job, run=job.runs[0], goal=None, tolerances=points, speeds=())


def placement() -> ac.Placement:
    job = parse_job(CORNER_JOB)
    best = Place(values={"x": 0.01, "yaw": np.pi / 2}, verdict=Verdict(bound=1.4, duration=1.5))
    return ac.Placement(
        job=job,
        run=job.runs[0],
        axes=(),
        moves=None,  # type: ignore[arg-type]
        objective="cycle",
        verdicts=(best.verdict, Verdict(bound=1.6), Verdict(refusal="reach")),
        best=best,
        refined=best,
        own=Verdict(refusal="reach"),
    )


class Jobs(list[int]):
    name = "grid"


def batched() -> ac.Batch:
    return ac.Batch(
        plan=Jobs(range(400)),  # type: ignore[arg-type]
        folder=FilePath("out"),
        counts={"done": 300, "refused": 80},
        errors={"Unreachable": 80},
    )


def spread() -> Spread:
    n, two = np.arange(1.0, 101.0), np.zeros((100, 2))
    return Spread(
        max=n * 1e-6,
        rms=n * 1e-7,
        until=n,
        saturated=0 * n,
        demand_ratio=n / 100,
        kp=two,
        kv=None,
        dead_time=two,
        payload=0 * n,
        seed=7,
        names=("kp of joint 1", "payload"),
        deviations=np.column_stack([n / 1e3, -n / 1e3]),
        nominal_max=1e-6,
        nominal_rms=1e-7,
    )


def near(first: str, second: str, high: float, **more: Any) -> PairClearance:
    given = {"kind": "environment", "margin": 0.01, "low": high - 1e-4, "t": 1.25}
    return PairClearance(
        first=first, second=second, high=high, points=np.zeros((2, 3)), **given | more
    )


def drawing() -> ac.Program:
    square = ac.Path.polyline([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1], [0, 0]])
    line = ac.Path.polyline([[0.2, 0], [0.3, 0]])
    moves = (
        ac.Contour(path=square, layer="CUT"),
        ac.Dwell(duration=0.5),
        ac.Contour(path=line, layer="MARK"),
    )
    return ac.Program(moves=moves, source="part.dxf", notes=("A text was left out.",))


def oriented() -> ac.Path:
    path = ac.Path.polyline([[0, 0, 0], [0.1, 0, 0], [0.1, 1.9, 0]], demand=ac.Demand(speed=0.05))
    return path.pointing([0, 0, -1])


def shaped() -> ac.ShapedPath:
    path = ac.Path.polyline([[0, 0], [0.1, 0]])
    outcome = Outcome(start="arcs", durations={"arcs": 1.5, "stops": 2.0, "shaped": 1.25})
    places = [[0.0, 0.0], [0.1, 0.1]]
    return ac.ShapedPath(
        segments=path.segments, objective=path, places=places, tolerance=2e-3, outcome=outcome
    )


@cache
def check() -> ac.Check:
    job, x = parse_job(CORNER_JOB), result()
    return ac.check(x.trajectory, job.arm, x.run.limits)


def tally() -> ac.Tally:
    given = {"statuses": {"done": 190, "refused": 10}, "errors": {"Unreachable": 10}}
    return ac.Tally(total=400, done=300, before=100, seconds=20.0, workers="2 processes", **given)


def clearance(high: float, **more: Any) -> ac.Clearance:
    pairs = (near("forearm", "table", high, **more), near("tool", "vice", 0.5))
    return ac.Clearance(pairs=pairs)


def identification() -> ac.Identification:
    joints = (servo_joint("joint 1"), servo_joint("joint 2"))
    return ac.Identification(log=log(), interpolation="linear", joints=joints)


# Results, and what `print` shows of them.
MADE: dict[str, tuple[Callable[[], Any], str]] = {
    "Arm": (
        lambda: ac.load_arm("ur5e"),
        """\
UR5e: 6 joints, in space, with masses, with shapes""",
    ),
    "Batch": (
        batched,
        """\
Batch grid: 400 jobs
  done               300
  refused            80
  without a result   20
  error Unreachable  80
  folder             out""",
    ),
    "Certificate": (
        certificate,
        """\
Certified: corner, run only: 2.1855 s
  cost                 +0.0 ms to 2.1855 s
  contour error        at most 0.004192 mm
  of it servo          0.004057 mm
    command interval   0.0001347 mm
  rounding of corners  2 mm
  left                 0.09581 mm of 0.1 mm
  derated, mean        0.00%, 0.00%
  saturated            24.4%, 31.9%
  limits of the plan   kept, between samples too
  holds for            independent joint servos of order second with kp 25 1/s and kv 150 1/s;
                       set-points every 4 ms, interpolated linearly; accelerations that saturate
                       at the joints' limits""",
    ),
    "Check": (
        check,
        """\
Check: kept, 207896 times from 0 to 2.18552 s
  limit                      share       value           of        at  joint  verdict
  joint acceleration        1.0000        0.72  0.72 rad/s²   0.574 s      2  kept
  centripetal acceleration  1.0000        0.09    0.09 m/s²   1.332 s         kept
  speed                     0.6572    0.098587     0.15 m/s   0.574 s         kept
  position step             0.0000  2.2204e-16       1e-09   0.4603 s      2  kept
  velocity step             0.0000  1.6653e-16      0.0001   0.6219 s      1  kept""",
    ),
    "Clearance": (
        lambda: clearance(0.02),
        """\
Clearance: kept (2 pairs, 0 not looked at)
  pair               distance       at  margin
  table and forearm     20 mm  1.250 s   10 mm""",
    ),
    "Clearance, too near": (
        lambda: clearance(0.005, first_time=1.2),
        """\
Clearance: 1 pair too near (2 pairs, 0 not looked at)
  pair               distance       at  margin
  table and forearm      5 mm  1.200 s   10 mm""",
    ),
    "ContourCertificate": (
        lambda: certificate().worst,
        """\
Certified: contour 1: 2.1855 s
  cost                 +0.0 ms to 2.1855 s
  contour error        at most 0.004192 mm
  of it servo          0.004057 mm
    command interval   0.0001347 mm
  rounding of corners  2 mm
  left                 0.09581 mm of 0.1 mm
  derated, mean        0.00%, 0.00%""",
    ),
    "ErrorProfile": (
        lambda: result().evaluation.contour_error,
        """\
Error profile: RMS 1.807e-06, largest 4.192e-06 at t = 1.076 s, s = 0.05609 m (m or rad)""",
    ),
    "Evaluation": (
        lambda: result().evaluation,
        """\
Evaluation: 2.1855 s of motion, at rest after 2.1930 s
  contour error         0.001807 mm RMS, 0.004192 mm largest (t = 1.076 s, s = 0.05609 m)
  path missed           0.004192 mm largest (t = 1.076 s, s = 0.05609 m)
  tracking error        0.6847 mm RMS, 1.301 mm largest (t = 0.581 s, s = 0.02782 m)
  objective error       0.2625 mm RMS, 1.417 mm largest (t = 1.214 s, s = 0.05858 m)
  objective missed      2.004 mm largest (t = 1.213 s, s = 0.06 m)
  corners               2.004 mm from 1 corner
  tool speed            97.47 mm/s largest, 44.79 mm/s mean, 0.6498 of what is assigned
  joint demand / limit  1.0393 (joint 2)
  saturated             joint 1 24.41%, joint 2 31.85% of the time
  joints fully used     74.5% of the time""",
    ),
    "Execution": (
        lambda: result().execution,
        """\
Execution of PMK-3s: t = 0.0000 to 2.6800 s, 2681 samples every 1 ms
  joint       position [rad]  velocity [rad/s]  acceleration [rad/s²]  saturated
  joint 1  -0.1812 to 0.0593            0.3967                   0.72   654.2 ms
  joint 2   1.5754 to 1.9671            0.3665                   0.72   853.6 ms""",
    ),
    "Explanation": (
        lambda: result().explanation,
        """\
Explanation: 2.1855 s, 0.0% of the length as assigned
  limit                         time  share
  joint 2 acceleration      1.0644 s  48.7%
  joint 1 acceleration      0.7564 s  34.6%
  centripetal acceleration  0.3638 s  16.6%
  between two limits        0.0009 s   0.0%
  slowest place: centripetal acceleration at s = 0.059 m: 0.0208 of 0.15 m/s""",
    ),
    "Identification": (
        identification,
        """\
Servo identified from robot.csv, set-points linear
  joint    kp            kv            dead time   acceleration      residuals
  joint 1  25 ±0.25 1/s  150 ±1.5 1/s  4 ±0.04 ms  above 3.5 rad/s²  0.0125 mrad
  joint 2  25 ±0.25 1/s  150 ±1.5 1/s  4 ±0.04 ms  above 3.5 rad/s²  0.0125 mrad""",
    ),
    "Job": (
        lambda: parse_job(BEND),
        """\
Job bend
  arm       UR5e: 6 joints, in space, with masses, with shapes
  path      1 contour, 0.1 m
  run fast  optimal, pole_placement, every 4 ms, 250 mm/s""",
    ),
    "JointIdentification": (
        lambda: servo_joint("joint 1"),
        """\
Servo of joint 1, second order
  kp            25 ±0.25 1/s
  kv            150 ±1.5 1/s
  dead time     4 ±0.04 ms
  acceleration  above 3.5 rad/s²
  residuals     0.0125 mrad RMS, white""",
    ),
    "JointPath": (
        lambda: result().joint_path,
        """\
Joint path: 0.09793 m, 2 joints, 29 intervals
  inner stops  0
  joint 1      -0.1812 to 0.0593 rad
  joint 2      1.5754 to 1.9671 rad""",
    ),
    "LearnedRun": (
        lambda: learned(1e-4),
        """\
Learned run from the execution
  contour error  0.1 mm RMS, 0.3 mm largest
  off the plan   0.2 mm RMS, 0.5 mm largest
  predicted      0.1 mm RMS
  joints, RMS    0.1 0.2 mrad
  noise          0.001 0.002 mrad""",
    ),
    "Lesson": (
        lesson,
        """\
Lesson of 2 runs: 608 set-points every 4 ms
  RMS errors       0.1 0.02 mm
  best run         run 2, 0.02 mm
  next run         0.005 mm expected
  does not repeat  0.002 mm, 1% of the square
  reason           why
  compensation     learned
  times            0.0000 to 2.4280 s
  plan             2.1855 s
  joint 1          -0.1812 to 0.0595 rad
  joint 2          1.5751 to 1.9671 rad""",
    ),
    "LimitUse": (
        lambda: check().worst,
        """\
joint acceleration of joint 2: 1.0000 of the limit, 0.72 of 0.72 rad/s² at t = 0.574 s, kept""",
    ),
    "Limits": (
        lambda: ac.load_arm("ur5e").limits.replace(joint_jerk=None, speed=0.25),
        """\
Limits
  joint_acceleration  3.142 rad/s²
  joint_velocity      3.142 rad/s
  joint_torque        150, 150, 150, 28, 28, 28 N m
  joint_lower         -6.283, -6.283, -3.142, -6.283, -6.283, -6.283 rad
  joint_upper         6.283, 6.283, 3.142, 6.283, 6.283, 6.283 rad
  speed               0.25 m/s""",
    ),
    "Limits, none": (ac.Limits, "Limits: none"),
    "Log": (
        log,
        """\
Log of 2 joints: 251 samples, t = 0.0000 to 1.0000 s
  source          robot.csv
  usual interval  4 ms
  set-points      interpolation unknown
  joint 1         0.0000 to 1.0000 rad
  joint 2         -1.0000 to 0.0000 rad""",
    ),
    "Orientation": (
        lambda: oriented().orientation,
        """\
tool axis constant""",
    ),
    "Path": (
        oriented,
        """\
Path in space: 2 m, 2 segments
  from         (0, 0, 0) mm
  to           (100, 1900, 0) mm
  corners      1
  assigned     50 mm/s
  orientation  tool axis constant""",
    ),
    "Placement": (
        placement,
        """\
Placement of the part: corner, run only, for cycle
  best place        x 10 mm, yaw 90°: 1.5000 s
  best of the grid  x 10 mm, yaw 90°: 1.5000 s
  the job's own     refused by reach
  places            3, 1 planned
  refused           1 by reach""",
    ),
    "Program": (
        drawing,
        """\
Program in the plane: 2 contours, 0.5 m
  source             part.dxf
  closed             1
  contours by layer  CUT 1, MARK 1
  lengths            100 mm to 400 mm
  other moves        1 dwell
  note               A text was left out.""",
    ),
    "Recording": (
        lambda: ac.Recording(t=log().t, q=log().measured),
        """\
Recording: 251 samples, t = 0.0000 to 1.0000 s
  source      the log
  clock       its own
  set-points  not recorded
  joint 1     0.0000 to 1.0000 rad
  joint 2     -1.0000 to 0.0000 rad""",
    ),
    "RobotIdentification": (
        robot,
        """\
PMK-3s, identified from a.csv
  payload         1.5 ±0.015 kg, at (0.1 ±0.001 m, 0.1 ±0.001 m, 0.1 ±0.001 m)
  dead time       4 ±0.04 ms
  drive inertias  1.1 ±0.011 of nominal
  joint 1         kp 25 ±0.25, kv 150 ±1.5, viscous 8 ±0.08, coulomb 6 ±0.06
  joint 2         kp 25 ±0.25, kv 150 ±1.5, viscous 8 ±0.08, coulomb 6 ±0.06""",
    ),
    "RoundedPath": (
        lambda: result().path.path,
        """\
Rounded path in the plane: 0.09793 m, 3 segments
  rounded               1 corner
  largest corner error  2 mm
  from                  (300, 200) mm
  to                    (360, 240) mm
  corners               0""",
    ),
    "RunPlan": (
        lambda: teach(parse_job(CORNER_JOB))["only"],
        """\
Run only: 2.1855 s
  method  optimal, compensation pole_placement
  path    1 contour, 0.09793 m
  taught  608 set-points every 4 ms""",
    ),
    "RunResult": (
        result,
        """\
Run only: 2.1855 s, at rest after 2.1930 s
  contour error         0.001807 mm RMS, 0.004192 mm largest
  joint demand / limit  1.0393
  method                optimal, compensation pole_placement
  path                  1 contour, 0.09793 m
  taught                608 set-points every 4 ms
  warnings              1, in .warnings""",
    ),
    "ShapedPath": (
        shaped,
        """\
Shaped path in the plane: 0.1 m, 1 segment
  tolerance        2 mm
  least durations  arcs 1.5 s, stops 2 s, shaped 1.25 s
  from             (0, 0) mm
  to               (100, 0) mm
  corners          0""",
    ),
    "Spread": (
        spread,
        """\
Spread over 100 drawn robots (seed 7)
  contour error    0.1 mm largest of all
  in 95 % of them  at most 0.096 mm
  nominal robot    0.001 mm
  demand / limit   1.0000 at most
  worst robot      kp of joint 1 +0.1, payload -0.1""",
    ),
    "Study": (
        lambda: ac.Study(job=parse_job(CORNER_JOB), runs={"only": result()}),
        """\
Study of corner, 1 warning
  run     motion    RMS error      largest  demand / limit
  only  2.1855 s  0.001807 mm  0.004192 mm          1.0393""",
    ),
    "Sweep": (
        swept,
        """\
Sweep of corner, run only
  tolerance     speed  corners   optimum  certified  contour error
  1 mm       150 mm/s      arc  1.5000 s   1.5100 s        0.09 mm
  2 mm       150 mm/s      arc  1.5000 s    refused""",
    ),
    "Tally": (
        tally,
        """\
300 of 400 jobs done
  rate     10 jobs/s, 10 s left
  results  190 done, 10 refused
  errors   10 Unreachable
  workers  2 processes""",
    ),
    "TaughtData": (
        lambda: result().taught,
        """\
Taught data: 608 set-points every 4 ms
  compensation  pole_placement
  times         0.0000 to 2.4280 s
  plan          2.1855 s
  joint 1       -0.1812 to 0.0595 rad
  joint 2       1.5751 to 1.9671 rad""",
    ),
    "Trajectory": (
        lambda: result().trajectory,
        """\
Trajectory: 2.1855 s, 2 joints
  method  optimal
  path    0.09793 m
  moves   1 contour""",
    ),
    "TransferredData": (
        lambda: ac.TransferredData(**taught(), explained=0.97),
        """\
Transferred data: 608 set-points every 4 ms
  explained     97% of what was learned
  compensation  learned
  times         0.0000 to 2.4280 s
  plan          2.1855 s
  joint 1       -0.1812 to 0.0595 rad
  joint 2       1.5751 to 1.9671 rad""",
    ),
}


def alike(found: str, golden: str) -> None:
    """The same words in the same lines; numbers differ by a unit of their last digit at most."""
    number = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
    words = [
        [" ".join(number.sub("#", x).split()) for x in y.splitlines()] for y in (found, golden)
    ]
    assert words[0] == words[1]
    for here, there in zip(found.splitlines(), golden.splitlines(), strict=True):
        pairs = list(zip(number.findall(here), number.findall(there), strict=True))
        # Where and when a rounding error is the largest one, rounding decides.
        if any(0 < abs(float(b)) < 1e-12 for _, b in pairs):
            continue
        for a, b in pairs:
            mantissa, _, power = b.partition("e")
            last = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
            assert abs(float(a) - float(b)) <= 1.01 * last, (a, b)


@pytest.mark.parametrize("name", MADE)
def test_a_result_prints_what_a_person_can_read(name: str) -> None:
    make, golden = MADE[name]
    found = make()
    text = str(found)
    alike(text, golden)
    lines = text.splitlines()
    assert len(lines) <= MOST_LINES + 2 and max(map(len, lines)) < 100
    # In a log, or among other values, it is one line without pages of numbers.
    assert "\n" not in repr(found) and len(repr(found)) < 1000
    assert type(found).__name__ in repr(found)


def test_samples_are_one_line_in_a_notebook() -> None:
    found = repr(result().trajectory.sample(0.5))
    assert found.startswith("Samples(t=[0.0, 0.5, ") and "\n" not in found and len(found) < 300


def test_a_plant_says_what_it_moves() -> None:
    arm = ac.load_arm("pmk3s")
    plant = ac.ServoPlant(arm, ac.ServoModel(kp=25.0, kv=150.0))
    assert repr(plant) == f"ServoPlant({arm!r})" == "ServoPlant(PlanarTwoLink('PMK-3s', 2 joints))"


def test_every_result_of_a_public_function_has_a_form_of_its_own() -> None:
    results = set()
    for name in ac.__all__:
        value = getattr(ac, name)
        if inspect.isfunction(value):
            said = re.findall(r"\w+", str(inspect.signature(value).return_annotation))
            results |= {x for x in said if inspect.isclass(getattr(ac, x, None))}
    # What these results hold, and what a user may be given besides.
    results |= {"LimitUse", "LearnedRun", "Recording", "Tally", "Lesson", "ShapedPath"}
    assert {"Certificate", "Path", "Study", "Identification"} <= results <= set(MADE)
    plain = [
        x for x in results if inspect.getattr_static(getattr(ac, x), "__str__") == object.__str__
    ]
    assert plain == []


def test_rows_are_aligned_and_empty_ones_left_out() -> None:
    rows = [("a", "1", "x"), ("nothing", "", ""), ("long name", "", "yy")]
    assert line_up("Title", rows, columns="><") == ("Title\n  a          1  x\n  long name     yy")
    assert line_up("Title") == "Title"


def test_long_texts_go_on_in_the_next_line_and_long_tables_end() -> None:
    text = line_up("Title", [("name", "word " * 30)])
    first, *others = text.splitlines()[1:]
    assert all(len(x) <= WIDTH and x.startswith(" " * 8 + "word") for x in others)
    assert text.split() == ["Title", "name", *["word"] * 30]
    lines = line_up("Title", [(f"{k}", "x") for k in range(100)]).splitlines()
    assert len(lines) == MOST_LINES and lines[-1] == "  ... and 87 more lines"
    assert lines[-2].split() == ["12", "x"]


def test_texts_of_other_people_do_not_control_the_terminal() -> None:
    text = line_up("a\x1b[2J", [("b\nc", "d\x07")])
    assert text.splitlines() == ["a\\x1b[2J", "  b\\nc  d\\x07"]


def test_numbers_are_short() -> None:
    assert [digits(x) for x in (0, 0.0123456, 12.3456, 12345.6, -98765.4, 1e-7)] == [
        *("0", "0.01235", "12.35", "12346", "-98765", "1e-07")
    ]
    assert extremes([]) == "" and extremes([0.002, 0.001]) == "1 mm to 2 mm"
    assert extremes([0.001, 0.001]) == "1 mm"


def test_brief_names_arrays_by_their_shapes() -> None:
    assert brief(log()) == (
        "Log(t=<251 array>, command=<251x2 array>, measured=<251x2 array>, "
        "joint_names=('joint 1', 'joint 2'), interpolation=None, "
        "set_points=False, source='robot.csv')"
    )
    many = {f"run {k}": 1 for k in range(20)}
    assert "runs=<20 str>" in brief(ac.Study(job=parse_job(BEND), runs=many))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "count", "text"),
    [(118.4, 2, "118"), (99.7, 2, "100"), (9999.7, 4, "10000"), (0.01234, 2, "0.012")],
)
def test_digits_have_no_exponent_where_numbers_are_large(value, count, text):
    assert digits(value, count) == text
