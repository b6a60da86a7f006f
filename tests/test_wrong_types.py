"""Every public function says in one sentence that it got another object than it takes."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

import armcontour as ac
from armcontour.cli.running import built_in_job

Call = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]
OTHERS = (None, "text", 3.5, [1, 2], {"a": 1}, np.zeros((2, 2)), object())
# Objects among them that are right.
TAKEN = {
    ("export", "file"): str,
    ("export", "name"): str,
    ("write_report", "file"): str,
    ("Payload", "mass"): float,
    ("Process", "layers"): dict,
}
TOLERANCE = "tolerance"


@pytest.fixture(scope="module")
def calls(
    objective: ac.Path,
    arm: ac.PlanarTwoLink,
    limits: ac.Limits,
    servo: ac.ServoModel,
    conventional: ac.Trajectory,
) -> dict[str, Call]:
    """Calls whose arguments are each replaced by other objects."""
    taught = ac.compensate(conventional, servo, method="none")
    plant = ac.ServoPlant(arm, servo, limits)
    job = built_in_job()
    contour = ac.Contour(path=objective)
    planned = ac.plan(ac.round_corners(objective, tolerance=5e-3), arm, limits)
    return {
        "round_corners": (ac.round_corners, (objective,), {"tolerance": 1e-3}),
        "smooth_curvature": (ac.smooth_curvature, (objective,), {"tolerance": 1e-5}),
        "plan": (ac.plan, (objective, arm), {"limits": limits}),
        "shape": (ac.shape, (objective, arm), {"limits": limits, "tolerance": 1e-3}),
        "compensate": (ac.compensate, (conventional, servo), {"arm": arm, "limits": limits}),
        "execute": (ac.execute, (taught, plant), {}),
        "evaluate": (ac.evaluate, (None, objective), {"limits": limits}),
        "explain": (ac.explain, (planned, arm), {"limits": limits}),
        "check": (ac.check, (planned, arm), {"limits": limits}),
        "export": (ac.export, (taught, "a.csv"), {"arm": arm, "name": "a", "outputs": {}}),
        "prepare": (ac.prepare, (objective, ac.Process()), {}),
        "run": (ac.run, (job,), {}),
        "certify": (ac.certify, (job,), {}),
        "sweep": (ac.sweep, (job,), {}),
        "place": (ac.place, (job,), {}),
        "read_job": (ac.read_job, ("a.yaml",), {}),
        "read_log": (ac.read_log, ("a.csv",), {}),
        "write_report": (ac.write_report, (None, "a.html"), {}),
        "check_clearance": (ac.check_clearance, (planned, arm), {"scene": ac.Scene()}),
        "ServoPlant": (ac.ServoPlant, (arm, servo), {"limits": limits}),
        "RigidBodyPlant": (ac.RigidBodyPlant, (arm, servo), {}),
        "Contour": (ac.Contour, (), {"path": objective, "events": ()}),
        "Program": (ac.Program, (), {"moves": (contour,)}),
        "Process": (
            ac.Process,
            (),
            {"lead_in": None, "lead_out": None, "switch": None, "tabs": None, "weave": None}
            | {"events": (), "analog": (), "off_between": (), "by_layer": {}, "layers": {}},
        ),
        "Payload": (ac.Payload, (), {"mass": 1.0, "center": (0.0, 0.0, 0.0)}),
    }


def refused(function: Callable[..., Any], args: list[Any], options: dict[str, Any]) -> str:
    """What a call says that is refused; empty if it is not."""
    try:
        function(*args, **options)
    except ac.ArmContourError as error:
        return str(error)
    return ""


def test_other_objects_are_refused_in_one_sentence(
    calls: dict[str, Call], tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, (function, args, options) in calls.items():
        names = list(inspect.signature(function).parameters)
        slots: list[int | str] = [*range(len(args)), *(x for x in options if x != TOLERANCE)]
        for slot in slots:
            called = names[slot] if isinstance(slot, int) else slot
            default = inspect.signature(function).parameters[called].default
            for other in OTHERS:
                if other is default or isinstance(other, TAKEN.get((name, called), ())):
                    continue
                given, more = list(args), dict(options)
                if isinstance(slot, int):
                    given[slot] = other
                else:
                    more[slot] = other
                said = refused(function, given, more)
                assert said.endswith(".") and "\n" not in said, (name, called, other, said)
    assert not list(tmp_path.iterdir())


def test_the_sentence_says_what_is_needed_and_where_it_comes_from(
    calls: dict[str, Call], refuses: Callable[..., None], servo: ac.ServoModel
) -> None:
    (path, arm), conventional = calls["plan"][1], calls["compensate"][1][0]
    cases: list[tuple[Callable[[], Any], str]] = [
        (
            lambda: ac.compensate(path, servo),
            "compensate needs a Trajectory, as plan gives it, not Path.",
        ),
        (
            lambda: ac.compensate(conventional, (25, 150)),  # type: ignore[arg-type]
            "compensate needs a ServoModel, such as ServoModel(kp=25, kv=150), not tuple.",
        ),
        (
            lambda: ac.run("job.yaml"),  # type: ignore[arg-type]
            "run needs a Job, as read_job gives it, not str.",
        ),
        (
            lambda: ac.explain(conventional, arm, {"speed": 1}),  # type: ignore[arg-type]
            "explain needs Limits, such as arm.limits.replace(speed=0.1), not dict.",
        ),
        (
            lambda: ac.Program(moves=ac.Contour(path=path)),  # type: ignore[arg-type]
            "moves of a program must be a list of Contours, Rapids, Dwells and Events",
        ),
    ]
    for call, sentence in cases:
        refuses(call, ac.InvalidInput, sentence)


# Values that are no numbers. Not-a-number itself goes through functions of arrays, as in numpy.
NO_NUMBERS = (
    *("a", None, 1 + 2j, object(), {}, ["a", "b"], [[1.0], [2.0, 3.0]], True, b"a"),
    *(np.zeros(2, complex), np.array(["2020-01-01"], "M8[D]"), 10**400),
    *([None, 0.1], np.array(["1", 2.0], object), np.array([True, 0.1], object)),
)
# Arrays of no state of an arm with two or six joints.
NO_STATES = ([], [1.0, 2.0, 3.0], np.zeros((2, 3, 4)), 0.5)


def test_functions_of_numbers_refuse_what_is_none_in_one_sentence(
    calls: dict[str, Call], rounded: ac.RoundedPath, arm: ac.PlanarTwoLink, traced: ac.JointPath
) -> None:
    planned, servo = calls["check"][1][0], calls["compensate"][1][1]
    space = ac.load_arm("ur5e")
    functions: list[tuple[Callable[..., Any], int, tuple[Any, ...]]] = [
        (rounded, 1, NO_NUMBERS),
        (rounded.locate, 1, NO_NUMBERS),
        (rounded.project, 1, (*NO_NUMBERS, *NO_STATES)),
        (traced, 1, NO_NUMBERS),
        (traced.locate, 1, NO_NUMBERS),
        *((x, 1, NO_NUMBERS) for x in (planned, planned.motion, planned.s, planned.with_rests)),
        (planned.motion_with_rests, 1, NO_NUMBERS),
        *((x, 1, NO_NUMBERS) for x in (planned.time_at, planned.speed_at, planned.sample)),
        (arm.inverse, 1, (*NO_NUMBERS, *NO_STATES)),
        (servo.command, 3, NO_NUMBERS),
    ]
    states = (*NO_NUMBERS, *NO_STATES)
    for x in (arm, space):
        functions += [(f, 1, states) for f in (x.forward, x.jacobian, x.links)]
        functions += [(f, 2, states) for f in (x.jacobian_rate, x.tool_velocity)]
        functions += [(f, 3, states) for f in (x.tool_acceleration, x.tool_motion, x.torque)]
        functions.append((x.tool_jerk, 4, states))
    functions += [(arm.joint_velocity, 2, states), (arm.joint_acceleration, 3, states)]
    functions += [(space.pose, 1, states), (space.tool_twist_rate, 3, states)]
    for function, count, wrong in functions:
        dof = 6 if getattr(function, "__self__", None) is space else 2
        right = np.full(dof, 0.3) if wrong is states or count == 3 else 0.1
        for slot in range(count):
            for other in wrong:
                given = [right] * count
                given[slot] = other
                said = refused(function, given, {})
                assert said.endswith(".") and "\n" not in said, (function, slot, other, said)


@pytest.mark.parametrize("order", ["a", None, 0.5, -1, True, [1], np.zeros(2), 10**400])
def test_derivatives_have_whole_orders(
    calls: dict[str, Call],
    rounded: ac.RoundedPath,
    traced: ac.JointPath,
    order: Any,
    refuses: Callable[..., None],
) -> None:
    for curve in (rounded, traced, calls["check"][1][0]):
        refuses(
            lambda curve=curve: curve(0.0, order),
            ac.InvalidInput,
            "The order of a derivative must be a whole number from 0 to",
        )
    assert rounded(0.0, np.int64(1)).shape == (2,)


def test_words_and_sides_of_arrays_are_refused(
    rounded: ac.RoundedPath, refuses: Callable[..., None]
) -> None:
    refuses(lambda: rounded(0.0, side=np.zeros((2, 2))), ac.InvalidInput, "side must be left or")  # type: ignore[arg-type]
    refuses(
        lambda: ac.ServoModel(kp=1.0, kv=2.0, order=np.zeros(2)),  # type: ignore[arg-type]
        ac.InvalidInput,
        "order must be one of second, first, not",
    )


def test_a_joint_path_needs_an_interval_for_each_arc_length(
    traced: ac.JointPath, refuses: Callable[..., None]
) -> None:
    # Compiled code would read past the end of the arrays.
    for i in ([], [0, 1], [10**9], [-1]):
        refuses(
            lambda i=i: traced.motion(i, [0.1]),
            ac.InvalidInput,
            "one interval for each arc length, from 0 to",
        )
    assert traced.motion([0], [0.0])[0].shape == (1, 2)
    assert traced.motion([], [])[0].shape == (0, 2)


def test_parts_of_arms_are_of_their_class(
    arm: ac.PlanarTwoLink, refuses: Callable[..., None]
) -> None:
    space = ac.load_arm("ur5e")
    wrong: list[tuple[Callable[[Any], Any], str]] = [
        (arm.with_limits, "with_limits needs a Limits"),
        (arm.with_shapes, "with_shapes needs an ArmShapes"),
        (lambda x: arm.with_dynamics(payload=x), "with_dynamics needs a Payload"),
        (space.with_tool, "with_tool needs a Frame"),
        (space.with_work, "with_work needs a Frame"),
        (lambda x: ac.SerialArm(name="a", chain=x, limits=space.limits), "needs a Chain"),
        (lambda x: ac.SerialArm(name="a", chain=space.chain, limits=x), "needs a Limits"),
        (lambda x: ac.PlanarTwoLink(name="a", base=0, links=(1, 1), limits=x), "needs a Limits"),
        (lambda x: ac.Scene(obstacles=x), "obstacles of a scene must be a list of Obstacles"),
    ]
    for make, words in wrong:
        for other in (3.5, "text", [1.0]):
            refuses(lambda make=make, other=other: make(other), ac.InvalidInput, words)
