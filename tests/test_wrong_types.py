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
