"""Calls with wrong arguments give a result or one sentence; `make soak` makes all."""

import numpy as np
import pytest
from soak import calls
from tests.dynamics_extra import needs_dynamics
from tests.public_names import PUBLIC

import armcontour as ac
from armcontour.planning.constraints import SecondOrder

# Base classes, errors, and what is identified from logs of a whole arm.
NOT_MADE = {
    "Arm", "CompensationOptions", "PlanOptions", "Plant",
    # What moves a robot is tested in tests/controllers.
    "Chunk", "LinuxCNC", "Motion", "Played", "PlayedMotion", "RollingRows", "play",
}  # fmt: skip


@pytest.fixture(scope="module")
def files():
    with calls.folder():
        yield


@needs_dynamics
def test_every_public_name_is_called(files):
    made = {call.name for call in calls.calls()}
    classes = {name: x for name, x in PUBLIC.items() if isinstance(x, type)}
    errors = {name for name, x in classes.items() if issubclass(x, ac.ArmContourError)}
    assert set(PUBLIC) - made == NOT_MADE | errors


@needs_dynamics
def test_wrong_arguments_give_a_result_or_a_message_of_one_sentence(files):
    values = calls.bad_values()
    wrong = []
    refused = 0
    for k, (call, name) in enumerate(calls.slots()):
        # One value for each argument, another one for the next: all kinds of arguments get all.
        result, problem = calls.judge(call, {name: values[7 * k % len(values)]})
        refused += result in ("InvalidInput", "ArmMismatch", "FileError")
        wrong += [f"{call.name}({name}={values[7 * k % len(values)]!r}): {problem}"] * bool(problem)
    assert not wrong, "\n".join(wrong)
    assert refused > 0.6 * len(calls.slots())


def test_arrays_of_wrong_shapes_never_reach_compiled_code(refuses):
    rows = np.zeros((3, 2, 2))
    wide = np.zeros((3, 2, 3))
    for begin, end in ((rows, wide), (rows[:, :1], rows), (rows[:2], rows), (rows[0], rows)):
        ends = tuple(begin), tuple(end)
        refuses(lambda e=ends: ac.JointPath.hermite([0, 1, 2], *e), ac.InvalidInput, "shape")
    path = calls.right()["joint_path"]
    for coefficients in (np.zeros((3, 1, 1)), (1.0, 2.0), None, "a"):
        constraint = SecondOrder("own", lambda s, side, c=coefficients: c, [-1.0], [np.inf])
        refuses(
            lambda c=constraint: ac.plan(
                path, calls.right()["arm"], options=ac.Optimal(constraints=[c])
            ),
            ac.InvalidInput,
            "coefficients of own",
        )
