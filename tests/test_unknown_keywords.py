"""Every public function that takes any keyword refuses the ones it does not know."""

import inspect

import armcontour as ac

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


def test_an_unknown_keyword_is_refused(limits, servo, refuses):
    # Calls that are right but for the keyword, and a name that exists.
    calls = {
        "Limits.replace": (limits.replace, "joint_velocity"),
        "ServoModel.replace": (servo.replace, "kp"),
    }
    assert set(takers()) == set(calls)
    for call, known in calls.values():
        refuses(lambda f=call: f(**{UNKNOWN: 1}), ac.InvalidInput, UNKNOWN, known)
