"""Every public function that takes any keyword refuses the ones it does not know."""

import inspect

import armcontour as ac
from armcontour.cli.running import built_in_job

UNKNOWN = "no_such_option"


def is_method(member):
    return inspect.isfunction(member) or inspect.ismethod(member)


def takers():
    """Public functions and methods with a `**parameter`, as `name` or `Class.method`."""
    for name in ac.__all__:
        value = getattr(ac, name)
        found = {name: value} if inspect.isfunction(value) else {}
        if inspect.isclass(value):
            members = inspect.getmembers(value, is_method)
            shown = [x for x in members if not x[0].startswith("_") or x[0] == "__init__"]
            found = {f"{name}.{key}": member for key, member in shown}
        for key, member in found.items():
            kinds = [x.kind for x in inspect.signature(member).parameters.values()]
            if inspect.Parameter.VAR_KEYWORD in kinds:
                yield key


def test_an_unknown_keyword_is_refused(objective, arm, limits, servo, conventional, refuses):
    job = built_in_job()
    # Calls that are right but for the keyword, and a name that exists, by method.
    calls = {
        "plan": (
            lambda **x: ac.plan(objective, arm, limits, **x),
            {"optimal": "intervals", "mac": "knots", "conventional": "no options"},
        ),
        "compensate": (
            lambda **x: ac.compensate(conventional, servo, **x),
            {"pole_placement": "poles", "none": "no options"},
        ),
        "certify": (lambda **x: ac.certify(job, **x), {None: "tolerance"}),
        "sweep": (lambda **x: ac.sweep(job, **x), {None: "tolerance"}),
        "Limits.replace": (limits.replace, {None: "joint_velocity"}),
        "ServoModel.replace": (servo.replace, {None: "kp"}),
    }
    assert set(takers()) == set(calls)
    for call, methods in calls.values():
        for method, known in methods.items():
            given = {UNKNOWN: 1} | ({"method": method} if method else {})
            refuses(lambda f=call, x=given: f(**x), ac.InvalidInput, UNKNOWN, known)
