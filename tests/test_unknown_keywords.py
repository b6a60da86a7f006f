"""Every public function that takes any keyword refuses the ones it does not know."""

import inspect
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import armcontour as ac
from armcontour.cli.running import built_in_job

UNKNOWN = "no_such_option"


def is_method(member: object) -> bool:
    return inspect.isfunction(member) or inspect.ismethod(member)


def takers() -> Iterator[str]:
    """Public functions and methods with a `**parameter`, as `name` or `Class.method`."""
    for name in ac.__all__:
        value = getattr(ac, name)
        found = {name: value} if inspect.isfunction(value) else {}
        if inspect.isclass(value):
            found = {
                f"{name}.{key}": member
                for key, member in inspect.getmembers(value, is_method)
                if not key.startswith("_") or key == "__init__"
            }
        for key, member in found.items():
            kinds = [x.kind for x in inspect.signature(member).parameters.values()]
            if inspect.Parameter.VAR_KEYWORD in kinds:
                yield key


@pytest.fixture(scope="module")
def calls(
    objective: ac.Path,
    arm: ac.PlanarTwoLink,
    limits: ac.Limits,
    servo: ac.ServoModel,
    conventional: ac.Trajectory,
) -> dict[str, list[tuple[Callable[..., Any], str]]]:
    """For each of them: calls that are right but for the keyword, and a name that exists."""
    job = built_in_job()
    return {
        "plan": [
            (lambda **x: ac.plan(objective, arm, limits, method="optimal", **x), "intervals"),
            (lambda **x: ac.plan(objective, arm, limits, method="mac", **x), "knots"),
            (lambda **x: ac.plan(objective, arm, limits, method="conventional", **x), "no options"),
        ],
        "compensate": [
            (lambda **x: ac.compensate(conventional, servo, method="pole_placement", **x), "poles"),
            (lambda **x: ac.compensate(conventional, servo, method="none", **x), "no options"),
        ],
        "certify": [(lambda **x: ac.certify(job, **x), "tolerance")],
        "sweep": [(lambda **x: ac.sweep(job, **x), "tolerance")],
        "Limits.replace": [(limits.replace, "joint_velocity")],
        "ServoModel.replace": [(servo.replace, "kp")],
    }


def test_every_taker_of_any_keyword_is_tested(calls: dict[str, Any]) -> None:
    assert set(takers()) == set(calls)


@pytest.mark.parametrize("name", sorted(takers()))
def test_an_unknown_keyword_is_refused_by_name_with_those_that_exist(
    name: str, calls: dict[str, Any], refuses: Callable[..., None]
) -> None:
    for call, known in calls[name]:
        refuses(lambda call=call: call(**{UNKNOWN: 1}), ac.InvalidInput, UNKNOWN, known)
