"""Examples in docstrings of public names run and print what they state."""

import doctest
import importlib
import inspect
import shutil
from itertools import chain

import pytest
from soak.step_box import step_box
from tests.dynamics_extra import needs_dynamics
from tests.public_names import PUBLIC

import armcontour as ac
from armcontour.controllers.linuxcnc import simulated_drives

needs_linuxcnc = pytest.mark.skipif(
    shutil.which("halcmd") is None, reason="needs the Debian package linuxcnc-uspace"
)
# Distances of bodies need the extra `dynamics`. A dry run looks at the drives of LinuxCNC.
MARKS = {"check_clearance": needs_dynamics, "play": needs_linuxcnc}
NAMES = [name for name in ac.__all__ if name != "__version__"]


def examples_of_methods():
    """Docstrings with an example, of the methods of public classes and their bases, by name."""
    found = {}
    owners = [x.__mro__ for x in PUBLIC.values() if inspect.isclass(x)]
    for owner in set(chain.from_iterable(owners)):
        if not owner.__module__.startswith("armcontour"):
            continue
        for name, member in vars(owner).items():
            function = inspect.unwrap(getattr(member, "__func__", member))
            if inspect.isfunction(function) and ">>>" in (function.__doc__ or ""):
                found[f"{owner.__name__}.{name}"] = function.__doc__
    return dict(sorted(found.items()))


METHODS = examples_of_methods()
# Modules whose functions have examples although they are not public.
EXPLAINED = (
    "core.frames",
    "core.quantities",
    "core.render",
    "core.result",
    "core.sampled_data",
    "core.text",
    "jobs.certificate_goal",
    "jobs.job",
)
FLAGS = doctest.ELLIPSIS
FILES = {
    "job.yaml": """
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]}
limits: {speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 10 ms
runs: {only: {compensation: {method: none}}}
certificate: {servo_error: 0.1 mm}
""",
    "part.csv": "x [mm],y [mm]\n300,200\n330,200\n",
    "box.step": step_box((40.0, 30.0, 20.0)),
}


def run(name, text, names):
    """Run the examples of a docstring with these objects; returns all objects after them."""
    example = doctest.DocTestParser().get_doctest(text, names, name, None, 0)
    assert example.examples, f"{name} has no example"
    said = []
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    assert runner.run(example, out=said.append, clear_globs=False).failed == 0, "".join(said)
    return example.globs


@pytest.fixture(scope="module")
def names():
    """The objects of the docstring of the package."""
    return run("armcontour", ac.__doc__, {})


@pytest.fixture(scope="module")
def folder(tmp_path_factory, names):
    """A folder with the files that examples read."""
    folder = tmp_path_factory.mktemp("examples")
    t = names["np"].arange(300) * 4e-3
    rows = [f"{x:.3f},{names['np'].sin(x):.5f},{names['np'].sin(x - 0.01):.5f}" for x in t]
    hal = simulated_drives(names["servo"], names["arm"], names["np"].zeros(2), 1e-3)
    files = FILES | {
        "machine.hal": "\n".join(hal),
        "log.csv": "\n".join(["t,u1,q1", *rows]),
        "motion.csv": "\n".join(["t [s],q1 [rad],q2 [rad]", *rows]),
    }
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("name", [pytest.param(x, marks=MARKS.get(x, ())) for x in NAMES])
def test_the_docstring_example_of_a_public_name_runs(name, names, folder, monkeypatch):
    monkeypatch.chdir(folder)
    run(name, inspect.getdoc(PUBLIC[name]), names)


@pytest.mark.parametrize("name", METHODS)
def test_the_docstring_example_of_a_method_runs(name, names, folder, monkeypatch):
    monkeypatch.chdir(folder)
    run(name, METHODS[name], dict(names))


@pytest.mark.parametrize("module", EXPLAINED)
def test_docstring_examples_of_a_module_run(module):
    explained = importlib.import_module(f"armcontour.{module}")
    examples = doctest.DocTestFinder(exclude_empty=True).find(explained)
    own = [x for x in examples if x.examples and x.name.rsplit(".", 1)[1] not in PUBLIC]
    assert own
    for example in own:
        run(example.name, example.docstring, {**vars(explained), "ac": ac})
