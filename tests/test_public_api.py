"""Public names exist, load lazily, and refuse wrong arguments."""

import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.public_names import OWNED, PUBLIC
from tools.stubs import stubs

import armcontour as ac
from armcontour import files


def test_every_public_name_exists():
    for name in ac.__all__:
        value = getattr(ac, name)
        if name == "__version__":
            assert re.fullmatch(r"\d+\.\d+\.\d+\w*", value)
        else:
            # A class or a function of the package under its own name, and no module or import.
            assert inspect.isclass(value) or inspect.isfunction(value)
            assert value.__name__ == name and value.__module__.startswith("armcontour.")
    assert ac.__all__ == sorted(ac.__all__)
    assert dir(ac) == ac.__all__
    with pytest.raises(AttributeError, match="'armcontour' has no attribute 'does_not_exist'"):
        ac.does_not_exist  # noqa: B018


def test_each_public_name_belongs_to_one_package():
    assert len(ac.__all__) <= 80
    for package, names in OWNED.items():
        names = names.split()
        assert set(names) <= set(importlib.import_module(f"armcontour.{package}").__all__)
        assert not set(names) & set(ac.__all__)


def test_type_stubs_have_the_names_of_their_packages():
    written = stubs()
    assert len(written) > 10
    for file, text in written.items():
        assert file.read_text(encoding="utf-8") == text
    for package in (ac, files):
        names = [x for homes in package._HOME.values() for x in homes.split()]
        assert len(names) == len(set(names))


def test_a_plan_without_jerk_limits_does_not_load_their_modules():
    code = """if True:
        import sys
        import armcontour as ac
        arm = ac.load_arm("pmk3s")
        ac.plan(ac.Path.polyline([[0.30, 0.20], [0.34, 0.20]]), arm, arm.limits.replace(speed=0.1))
        print(*(x for x in sys.modules if x.startswith("armcontour.")))
    """
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
    assert "armcontour.planning.optimal_timing" in loaded.split()
    for name in ("planning.jerk.limiter", "planning.jerk.interior_point"):
        assert f"armcontour.{name}" not in loaded.split()


ROOT = Path(__file__).parents[1]


def test_the_version_is_that_of_changelog_and_citation_file():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.findall(r"^## (\S+)", changelog, re.MULTILINE)[0]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert newest == cited["version"] == ac.__version__


UNKNOWN = "no_such_option"


def is_method(member):
    return inspect.isfunction(member) or inspect.ismethod(member)


def takers():
    """Public functions and methods with a `**parameter`, as `name` or `Class.method`."""
    for name, value in PUBLIC.items():
        functions = {name: value} if inspect.isfunction(value) else {}
        if inspect.isclass(value):
            members = inspect.getmembers(value, is_method)
            shown = [x for x in members if not x[0].startswith("_") or x[0] == "__init__"]
            functions = {f"{name}.{key}": member for key, member in shown}
        for key, member in functions.items():
            kinds = [x.kind for x in inspect.signature(member).parameters.values()]
            if inspect.Parameter.VAR_KEYWORD in kinds:
                yield key


def test_an_unknown_keyword_is_refused(limits, servo, refuses):
    # Calls that are right but for the keyword, and a name that exists.
    calls = {
        "Limits.only": (ac.Limits.only, "joint_velocity"),
        "Limits.replace": (limits.replace, "joint_velocity"),
        "ServoModel.replace": (servo.replace, "kp"),
    }
    assert set(takers()) == set(calls)
    for call, keywords in calls.values():
        refuses(lambda f=call: f(**{UNKNOWN: 1}), ac.InvalidInput, UNKNOWN, keywords)


# Results, and classes that only their subclasses make.
NOT_MADE = {
    *("Arm", "Plant", "Batch", "Certificate", "Check", "Clearance", "Evaluation", "Explanation"),
    "InterpolationCheck",
    *("Identification", "LearningRun", "LearningResult", "LimitUse", "Placement"),
    *("RoundedPath", "ShapedPath", "JobResult"),
}


def makers():
    """Public functions and constructors, by their names."""
    for name, value in PUBLIC.items():
        error = inspect.isclass(value) and issubclass(value, BaseException)
        if not error and name not in NOT_MADE:
            yield name, value
            for key, member in inspect.getmembers(value, inspect.ismethod):
                if not key.startswith("_"):
                    yield f"{name}.{key}", member


def test_unknown_arguments_are_refused_with_the_known_ones(refuses):
    callables = dict(makers())
    assert {"plan", "ServoModel", "ServoPlant", "Path.polyline", "load_arm"} <= set(callables)
    for key, value in callables.items():
        if key in takers():
            continue
        names = [x for x in inspect.signature(value).parameters if len(x) > 5]
        refuses(lambda f=value: f(**{UNKNOWN: 1}), ac.InvalidInput, UNKNOWN, *names[:1])
        for name in names[:3]:
            # One letter is missing.
            wrong = name[:-2] + name[-1]
            refuses(lambda f=value, x=wrong: f(**{x: 1}), ac.InvalidInput, wrong, name)
    refuses(lambda: ac.Limits(joint_speed=1), ac.InvalidInput, "joint_velocity")
    refuses(lambda: ac.plan(1, 2, 3, 4), ac.InvalidInput)
    refuses(lambda: ac.Line((0, 0)), ac.InvalidInput, "end")
    refuses(lambda: ac.Line((0, 0), (1, 0), start=(0, 0)), ac.InvalidInput)
    refuses(lambda: ac.Limits(1.0), ac.InvalidInput)


@pytest.fixture(scope="module")
def planned(objective, arm, limits):
    return ac.plan(ac.round_corners(objective, tolerance=5e-3), arm, limits)


def test_wrong_orders_sides_words_and_intervals_are_refused(planned, rounded, traced, refuses):
    cases = [
        (lambda curve=curve, order=order: curve(0.0, order))
        for order in ("a", None, 0.5, -1, True, [1], np.zeros(2), 10**400)
        for curve in (rounded, traced, planned)
    ]
    cases.append(lambda: rounded(0.0, side=np.zeros((2, 2))))
    cases.append(lambda: ac.ServoModel(kp=1.0, kv=2.0, order=np.zeros(2)))
    # A joint path needs an interval for each arc length: compiled code would read past the end.
    cases += [lambda i=i: traced.motion(i, [0.1]) for i in ([], [0, 1], [10**9], [-1])]
    for call in cases:
        refuses(call, ac.InvalidInput)
    assert rounded(0.0, np.int64(1)).shape == (2,)
    assert traced.motion([0], [0.0])[0].shape == (1, 2)
    assert traced.motion([], [])[0].shape == (0, 2)
