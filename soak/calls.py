"""Call public functions, classes and methods with arguments that they must refuse.

In each call, one or two arguments are wrong. The call may return a result, or raise an error of
armcontour with a message of one sentence. Any other error shows that an argument was not checked.
"""

from __future__ import annotations

import inspect
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import chdir, contextmanager
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import armcontour as ac
from armcontour import files, geometry, jobs
from armcontour.control.learning import Recording
from armcontour.files.exports import (
    CsvFormat,
    McapFormat,
    RosYamlFormat,
    TemplateFormat,
    URScriptFormat,
)
from armcontour.planning.constraints import SecondOrder
from armcontour.program import (
    Analog,
    Lead,
    Pierce,
    Switch,
    Tabs,
    Wait,
    Weave,
    smooth_curvature,
)
from armcontour.robot import scene
from armcontour.studies.placement import Placement
from armcontour.verification import check_interpolation
from armcontour.verification.clearance import Cell
from soak import Outcome
from soak.step_box import step_box

ROWS = [f"{t:.3f},{np.sin(t):.5f},{np.sin(t - 0.01):.5f}" for t in np.arange(300) * 4e-3]
# Files by their names: a short job for an arm in the plane, and what else is read.
FILES = {
    "bend.yaml": """
name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]}
limits: {speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s, dead_time: 4 ms}
cycle: 10 ms
runs: {only: {compensation: {method: none}}}
certificate: {servo_error: 0.1 mm}
""",
    "line.csv": "x [mm],y [mm]\n300,200\n330,200\n",
    "box.step": step_box((40.0, 30.0, 20.0)),
    "log.csv": "\n".join(["t,u1,q1", *ROWS]),
    "motion.csv": "\n".join(["t [s],q1 [rad],q2 [rad]", *ROWS]),
}
# Methods that only the package calls, with what it has checked; most of them are in inner loops.
INNER = {
    *("SegmentLimits.columns", "Execution.between", "Orientation.cut", "Orientation.even"),
    *("Orientation.join", "Orientation.place", "SecondOrder.allowed", "SecondOrder.discretize"),
    *("SecondOrder.usage", "ServoModel.check_orders", "ServoModel.check_gains"),
    *("ServoModel.saturate", "motion_between", "smooth_steps", "on_interval", "on_piece"),
    *("on_segment", "Uncertainty.half_widths"),
    *("rates_on_piece", "run", "times"),
    # `plan`, `compensate` and jobs call the methods of options.
    *("at_cycle", "check_jerk", "for_program", "reshape", "time", "without_duration"),
    *("set_points", "settling", "Limits.of_chain"),
    # Runs add their motions and tolerances to the formats that write them, and make their rule.
    *("with_motions", "of_run", "Job.rule"),
    # Clearance checks call shapes with unit vectors.
    "farthest",
    # Tracing holds joints, and changes their weights.
    *("hold_still", "holding", "weighting", "seen_from"),
    *(
        f"{name}Format.{method}"
        for name in ("Csv", "RosYaml", "URScript", "Template")
        for method in ("check", "describe", "parts", "write")
    ),
}
# Arguments that start processes, or wait for a server.
NOT_VARIED = {"workers", "processes", "threads"}


class Call(NamedTuple):
    """A call that is right: its name, what is called, and its arguments."""

    name: str
    function: Callable[..., Any]
    arguments: Mapping[str, Any]


class Nothing:
    """An object of no use; the class takes any arguments."""

    def __init__(self, *_: object, **__: object) -> None:
        pass


@contextmanager
def folder() -> Iterator[None]:
    """Return a context with a new current folder that contains the files."""
    with tempfile.TemporaryDirectory() as place, chdir(place):
        for name, text in FILES.items():
            Path(name).write_text(text, encoding="utf-8")
        yield


@cache
def right() -> dict[str, Any]:
    """Return right arguments by name."""
    arm = ac.load_arm("pmk3s")
    servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=4e-3)
    limits = arm.limits.replace(speed=0.1, joint_acceleration=[0.7, 0.7])
    job = files.parse_job(FILES["bend.yaml"])
    job_result = ac.run(job)
    straight = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20)])
    objective = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20), (0.33, 0.23)])
    path = ac.round_corners(objective, tolerance=1e-3)
    joint_path = ac.trace(path, arm)
    trajectory = ac.plan(joint_path, arm, limits, ac.Optimal(intervals=100))
    slow = ac.plan(joint_path, arm, limits.replace(speed=0.02), ac.Optimal(intervals=100))
    set_points = ac.compensate(trajectory, servo, ac.NoCompensation(), cycle=0.01)
    plant = ac.ServoPlant(arm, servo, limits)
    executed = ac.simulate(set_points, plant)
    arm_with_dynamics = arm.with_dynamics(armature=0.1, payload=ac.Payload(mass=0.5))
    t = np.arange(400) * 4e-3
    wave = 0.01 * np.sin(np.outer(t, [5.0, 7.0])) * np.clip(t, 0, 1)[:, None]
    log = ac.Log(t=t, command=wave, measured=np.roll(wave, 5, axis=0))
    rest = ac.Log(t=2 * t, command=0 * wave + set_points.q[0], measured=0 * wave + set_points.q[0])
    return locals()


def functions() -> list[tuple[Callable[..., Any], dict[str, Any]]]:
    """Return the public functions, with the arguments that have no default, and some others."""
    x = right()
    on = {"arm": x["arm"], "limits": x["limits"]}
    learned = {"set_points": x["set_points"], "executed": x["executed"], "arm": x["arm"]}
    shaped = ac.Shaped(tolerance=1e-3, iterations=1)
    return [
        (ac.arm_names, {}),
        (ac.batch, {"job": "bend.yaml", "over": {"limits.speed": [0.05]}, "workers": 0}),
        (ac.certify, {"job": x["job"]}),
        (ac.check, {"samples": x["trajectory"], **on}),
        (ac.check, {"samples": x["trajectory"].sample(0.01), **on}),
        (check_interpolation,
         {"points": x["trajectory"].sample(0.01), "controller": "jtc", "rate": 100.0, **on}),
        (ac.check_clearance, {"motion": x["trajectory"], "arm": x["arm"]}),
        *((ac.compensate, {"trajectory": x["slow"], "servo": x["servo"], "options": m, **on})
          for m in (ac.NoCompensation(), ac.Inverse(), ac.PolePlacement())),
        (ac.evaluate, {"executed": x["executed"], "path": x["path"]}),
        (ac.simulate, {"set_points": x["set_points"], "plant": x["plant"]}),
        (ac.explain, {"trajectory": x["trajectory"], **on}),
        (ac.export, {"data": x["set_points"], "file": "a.csv"}),
        (ac.identify, {"logs": x["log"]}),
        (ac.learn, learned | {"servo": x["servo"]}),
        (ac.load_arm, {"name": "pmk3s"}),
        (ac.place, {"job": x["job"]}),
        (ac.plan, {"path": x["path"], **on, "options": ac.Optimal(intervals=100)}),
        (ac.plan, {"path": x["joint_path"], **on, "options": ac.Optimal(intervals=100)}),
        (ac.plan, {"path": x["straight"], **on, "options": ac.Conventional()}),
        (ac.plan, {"path": x["straight"], **on, "options": ac.Paper(knots=10)}),
        (ac.plan, {"path": x["objective"], **on, "options": shaped}),
        (ac.prepare, {"program": x["path"], "process": ac.Process()}),
        (ac.read_job, {"file": "bend.yaml"}),
        (ac.read_log, {"file": "log.csv"}),
        (ac.read_model, {"file": "box.step"}),
        (ac.read_path, {"file": "line.csv"}),
        (ac.read_trajectory, {"file": "motion.csv"}),
        (ac.round_corners, {"path": x["objective"], "tolerance": 1e-3}),
        (ac.run, {"job": x["job"]}),
        (ac.shape, {"path": x["objective"], **on, "options": shaped}),
        (smooth_curvature, {"path": x["path"], "tolerance": 1e-5}),
        (ac.dwell_law, {"q": np.zeros(2), "duration": 1.0}),
        (ac.trace, {"path": x["path"], "arm": x["arm"]}),
        (ac.write_report, {"result": x["job_result"], "file": "a.html"}),
        # Names on the pages that only a package has.
        (geometry.round_path, {"path": x["objective"], "tolerance": 1e-3}),
        (files.parse_job, {"text": FILES["bend.yaml"]}),
        (plan_with, {"coefficients": nothing}),
    ]  # fmt: skip


def nothing(s: Any, side: str) -> Any:
    """Return the coefficients of a quantity that is zero."""
    return np.zeros((3, len(s), 1))


def plan_with(coefficients: Any) -> ac.Trajectory:
    """Plan with a constraint that has these coefficients."""
    x = right()
    constraint = SecondOrder("own", coefficients, [-0.05], [0.05])
    return ac.plan(
        x["joint_path"],
        x["arm"],
        options=ac.Optimal(intervals=100, constraints=[constraint]),
    )


def instances() -> Iterator[Any]:
    """Yield one object of each public class that users make or get."""
    x = right()
    space = ac.load_arm("ur5e")
    line = ac.Path.polyline([[0.5, 0.0, 0.2], [0.53, 0.0, 0.2], [0.53, 0.03, 0.2]])
    oriented = line.oriented(np.diag([1.0, -1.0, -1.0]))
    yield from (space, space.chain, oriented, oriented.orientation, ac.Frame(), ac.SegmentLimits())
    yield ac.round_corners(oriented, tolerance=1e-3)
    yield from x.values()
    yield from (ac.Line(start=[0, 0], end=[1, 0]), ac.Arc(start=[1, 0], center=[0, 0], angle=1.0))
    yield from (Analog(name="gas"), ac.Dwell(duration=1.0), ac.Event(name="gas"))
    yield from (Lead(length=1e-3), Pierce(time=0.1), ac.Rapid(), Switch(), ac.Process())
    yield Wait("clamp", within=1.0)
    yield from (Tabs(width=1e-3, count=2), Weave(width=1e-3, pitch=1e-3))
    line = {"axis": [0.0, 0.0, 1.0], "origin": [0.5, 0.0, 0.0], "lower": -3.0, "upper": 3.0}
    axis = ac.PositionerAxis(name="turn", velocity=1.0, acceleration=2.0, **line)
    yield from (
        ac.Payload(mass=1.0),
        ac.Rail(axis=[1.0, 0.0, 0.0], upper=2.0, velocity=1.0, acceleration=2.0),
        axis,
        ac.Positioner(axes=(axis,)),
        ac.CertificateGoal(servo_error=1e-4),
        ac.Scene(),
        scene.Margins(),
    )
    yield from (scene.Box(size=[0.1, 0.1, 0.1]), scene.Cylinder(radius=0.1, length=0.1))
    yield from (scene.Capsule(radius=0.1, length=0.1), scene.Sphere(radius=0.1))
    yield scene.Mesh(points=np.random.default_rng(0).normal(size=(10, 3)))
    yield ac.Obstacle(name="ball", shape=scene.Sphere(radius=0.1))
    yield SecondOrder("own", nothing, [-0.05], [0.05])
    yield jobs.Uncertainty(dead_time=1e-3)
    yield from (CsvFormat(), RosYamlFormat(), McapFormat())
    yield from (URScriptFormat(), TemplateFormat(template="kuka"))
    yield from (ac.Optimal(), ac.Shaped(tolerance=1e-3), ac.Paper(), ac.Conventional())
    yield from (ac.Inverse(), ac.PolePlacement(), ac.InverseDynamics(), ac.NoCompensation())
    yield ac.ServoFit()
    yield from (ac.ReadOptions(units="mm"),)
    yield from (Recording(t=x["t"], q=x["wave"]), Cell(x["arm"], ac.Scene()))
    contour = ac.Contour(path=x["path"])
    yield from (contour, ac.Program(moves=(contour,)))
    yield from (x["job"].runs[0], x["job"].runs[0].rounding)
    yield ac.identify(x["log"])
    yield ac.place(x["job"], {"x": [0.0, 0.005]})
    yield ac.certify(x["job"])
    yield ac.check_clearance(x["trajectory"], x["arm"])
    judged = ac.check(x["trajectory"], x["arm"])
    yield from (judged, judged.uses[0])
    yield check_interpolation(x["trajectory"].sample(0.01), x["arm"], "jtc", 100.0)
    yield ac.evaluate(x["executed"], x["path"])
    yield ac.RigidBodyPlant(x["arm_with_dynamics"], x["servo"])
    yield ac.shape(x["objective"], x["arm"], x["limits"], ac.Shaped(tolerance=1e-3, iterations=1))
    lesson = ac.learn(x["set_points"], x["executed"], arm=x["arm"], servo=x["servo"])
    yield from (lesson, lesson.runs[0])
    yield ac.explain(x["trajectory"], x["arm"], x["limits"])
    yield ac.batch("bend.yaml", {"limits.speed": [0.05]}, workers=0)


@cache
def calls() -> tuple[Call, ...]:
    """Return all calls: functions, then the constructor and the own methods of each class."""
    cases = [Call(f.__name__, f, arguments) for f, arguments in functions()]
    kinds = set[object]()
    for x in instances():
        kind = type(x)
        if kind in kinds or not kind.__module__.startswith("armcontour."):
            continue
        kinds.add(kind)
        cases.append(Call(kind.__name__, kind, made_of(x)))
        # Before Python 3.11.3, reading `__weakref__` fails.
        members = {y: getattr(x, y) for y in dir(x) if y != "__weakref__"}
        for name, method in members.items():
            if not inspect.ismethod(method):
                continue
            inner = {name, f"{kind.__name__}.{name}"} & INNER
            if (name != "__call__" and name.startswith("_")) or inner or method.__func__ in kinds:
                continue
            kinds.add(method.__func__)
            cases.append(Call(f"{kind.__name__}.{name}", method, arguments_of(method, x)))
    return tuple(cases)


def parameters_of(function: Callable[..., Any]) -> list[inspect.Parameter]:
    """Return the parameters of a function that have names."""
    parameters = inspect.signature(function).parameters.values()
    return [x for x in parameters if x.kind not in (x.VAR_POSITIONAL, x.VAR_KEYWORD)]


def made_of(x: Any) -> dict[str, Any]:
    """Return the arguments with which a class makes an object."""
    if isinstance(x, ac.PlanarTwoLink):
        return {"name": "arm", "base": 0.1, "links": (0.25, 0.215), "limits": x.limits}
    if isinstance(x, Cell):
        return {"arm": right()["arm"], "scene": ac.Scene()}
    return {y.name: getattr(x, y.name) for y in parameters_of(type(x)) if hasattr(x, y.name)}


def arguments_of(method: Callable[..., Any], x: Any) -> dict[str, Any]:
    """Return the arguments without a default for a method of an object."""
    q = np.full(getattr(x, "dof", 2), 0.3)
    arguments = right() | {
        **dict.fromkeys(("q", "dq", "ddq", "dddq"), q),
        **dict.fromkeys(("s", "t", "by", "cycle", "resolution"), 0.01),
        **dict.fromkeys(("velocity", "acceleration"), [0.01, 0.01]),
        **dict.fromkeys(("up", "directions", "direction"), [0.0, 0.0, 1.0]),
        **dict.fromkeys(("angles", "position"), [0.1, 0.2, 0.3]),
        **dict.fromkeys(("name", "layer"), "a"),
        **dict.fromkeys(("tool", "work", "place", "frame", "pose"), ac.Frame()),
        **dict.fromkeys(("index", "order"), 0),
        **dict.fromkeys(("begin", "end"), (q[None],) * 3),
        **{"i": np.array([0]), "dof": 2, "limits": ac.Limits(joint_velocity=1.0), "shapes": None},
        **{
            "points": np.full((2, getattr(x, "dimension", 2)), 0.3),
            "breaks": [0.0, 1.0],
            "rotations": np.eye(3),
        },
        **{"motion": right()["trajectory"], "segments": [ac.Line(start=[0, 0], end=[1, 0])]},
        **{"change": lambda path: path, "timing": "optimal", "tolerance": 1e-3, "dimension": 2},
        **{"program": ac.Program(moves=(ac.Contour(path=right()["path"]),)), "given": {}},
        **{"others": ac.Limits(joint_velocity=2.0), "unit": "m"},
    }
    if method.__name__ in ("circle", "through"):
        arguments |= {
            "start": [1.0, 0.0],
            "via": [0.0, 1.0],
            "end": [-1.0, 0.0],
            "center": [0.0, 0.0],
        }
    if method.__name__ in ("spline", "polyline"):
        arguments["points"] = [[0.3, 0.2], [0.31, 0.2]]
    if isinstance(x, ac.Limits):
        arguments["name"] = "joint_velocity"
    if isinstance(x, ac.SerialArm):
        arguments["pose"] = x.forward(q)
    if isinstance(x, Placement):
        arguments |= {"name": "duration", "place": x.best}
    needed = [y.name for y in parameters_of(method) if y.default is y.empty or y.name == "ddq"]
    return {name: arguments[name] for name in needed if name in arguments}


def bad_values() -> list[Any]:
    """Return values that are wrong for most parameters."""
    x = right()
    return [
        *(None, "", "a", b"a", True, -1, 0, 3, 0.5, -1e-3, np.nan, np.inf, -np.inf, 10**400, 2**63),
        *(1 + 2j, Fraction(1, 3), object(), Nothing, Nothing()),
        *(lambda *_, **__: None, lambda *_, **__: "a", lambda *_, **__: np.zeros(3)),
        *([], (), {}, {"a": 1}, {1: None}, {1, 2}, range(3), [[1.0], [2.0, 3.0]], ["a", None]),
        *([np.nan, 1.0], (1.0, 2.0), [[1.0, 2.0]], [[[1.0]]], [object()], iter([1.0])),
        *(np.array([]), np.empty((0, 2)), np.zeros((2, 2)), np.full(3, np.nan), np.array(1.0)),
        *(np.zeros(2, complex), np.array(["a"]), np.array([None, 1.0], object), np.zeros(2, bool)),
        *(np.ma.masked_array([1.0, 2.0], [True, False]), np.array(["2020-01-01"], "M8[D]")),
        *(x["trajectory"], x["arm"], x["path"], x["joint_path"], x["limits"], x["servo"]),
        *(x["set_points"], x["job"], Path("none")),
    ]


@cache
def slots() -> tuple[tuple[Call, str], ...]:
    """Return all arguments that are replaced, with their calls."""
    pairs = [(x, y.name) for x in calls() for y in parameters_of(x.function)]
    return tuple((x, name) for x, name in pairs if name not in NOT_VARIED)


def judge(call: Call, bad: Mapping[str, Any]) -> tuple[str, str]:
    """Return what a call with bad arguments does, and what is wrong with that, or ""."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            call.function(**{**call.arguments, **bad})
    except ac.ArmContourError as error:
        message = str(error)
        sound = message.endswith(".") and "\n" not in message
        return type(error).__name__, "" if sound else f"no sentence: {message!r}"
    except Exception as error:  # noqa: BLE001 - every other error is a finding
        return "crash", f"{type(error).__name__}: {error}"
    return "result", ""


def run(seed: int) -> Outcome:
    """Make the call of a seed: first each argument with each bad value, then two at random."""
    with folder():
        values = bad_values()
        rng = np.random.default_rng(seed)
        call, name = slots()[seed % len(slots())]
        bad = {name: values[seed // len(slots()) % len(values)]}
        if seed >= len(slots()) * len(values):
            others = [y for x, y in slots() if x is call]
            bad[others[rng.integers(len(others))]] = values[rng.integers(len(values))]
        result, wrong = judge(call, bad)
    shown = ", ".join(f"{key}={value!r}" for key, value in bad.items())
    return Outcome(kind=call.name, result=result, notes=[f"{shown}: {wrong}"] if wrong else [])
