"""Docstrings, stated defaults and printed results."""

import dataclasses
import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
from tests.corner_job import CORNER_JOB
from tests.public_names import PUBLIC

import armcontour as ac
from armcontour.core.result import Data
from armcontour.core.text import MAX_LINES, format_table
from armcontour.files import parse_job
from armcontour.files.batch import Batch, BatchRow
from armcontour.studies.placement import Place, Placement

SECTIONS = ("Args", "Attributes", "Raises")
ENTRY = re.compile(r"(\*{0,2}\w+(?:, \*{0,2}\w+)*): *(.*)")


def is_ours(member):
    return (getattr(member, "__module__", None) or "").startswith("armcontour")


def methods(owner_class):
    """Public methods and properties that the package itself defines, inherited ones once."""
    for owner in owner_class.__mro__:
        if not is_ours(owner):
            continue
        for name, member in vars(owner).items():
            if name.startswith("_"):
                continue
            function = inspect.unwrap(getattr(member, "__func__", member))
            function = (
                getattr(function, "fget", None) or getattr(function, "func", None) or function
            )
            if inspect.isfunction(function):
                yield f"{owner.__name__}.{name}", function


def documented():
    """All public functions, classes and methods by their name."""
    members: dict[str, Any] = {}
    for name, value in PUBLIC.items():
        if inspect.isclass(value):
            members[name] = value
            members |= methods(value)
        else:
            members[name] = value
    return members


def parameters(function):
    """Parameters of a function, or those of a class's constructor."""
    names = list(inspect.signature(function).parameters)
    return {x for x in names if x not in ("self", "cls")}


def inherited(name):
    """Parameters that a base class documents: of the method of that name, or of its constructor."""
    class_name, _, method = name.partition(".")
    argument_names: set[str] = set()
    for base in BY_NAME[class_name].__mro__[1:] if class_name in BY_NAME else ():
        member = vars(base).get(method) if method else base
        if is_ours(base) and member is not None:
            argument_names |= set(sections(member.__doc__ or "").get("Args", {}))
    return argument_names


def sections(doc):
    """Names and descriptions in the sections of a docstring."""
    by_section: dict[str, dict[str, str]] = {}
    now: dict[str, str] | None = None
    name = ""
    for line in inspect.cleandoc(doc).splitlines():
        head = re.fullmatch(rf"({'|'.join(SECTIONS)}):", line)
        if head:
            now = by_section.setdefault(head[1], {})
        elif line and not line.startswith(" "):
            now = None
        elif now is not None and (entry := ENTRY.fullmatch(line[4:])) and line[4] != " ":
            for name in entry[1].replace("*", "").split(", "):
                assert name not in now, f"{name} stands there twice"
                now[name] = entry[2]
        elif now is not None and line.strip() and name:
            now[name] = f"{now[name]} {line.strip()}"
    return by_section


DOCUMENTED = documented()
# Public classes and their bases.
CLASSES = [x for x in PUBLIC.values() if inspect.isclass(x)]
BY_NAME = {base.__name__: base for x in CLASSES for base in x.__mro__}


def faults(name):
    """What is wrong with a docstring."""
    function = DOCUMENTED[name]
    if not function.__doc__:
        yield "no docstring"
        return
    lines = inspect.cleandoc(function.__doc__).splitlines()
    if not lines[0].endswith(".") or len(lines[0].split()) < 2 or "ikewise" in lines[0]:
        yield f"the summary is no sentence: {lines[0]}"
    if len(lines) > 1 and lines[1]:
        yield "no empty line after the summary"
    by_section = sections(function.__doc__)
    taken = parameters(function)
    listed = set(by_section.get("Args", {}))
    if dataclasses.is_dataclass(function):
        # A result's fields may be listed as attributes.
        listed |= set(by_section.get("Attributes", {})) & taken
    yield from (f"{x} has no description" for x in taken - listed - inherited(name))
    yield from (f"{x} is no parameter" for x in listed - taken)
    for section, entries in by_section.items():
        for key, text in entries.items():
            if not text.strip().endswith(".") or len(text.split()) < 2 or "ikewise" in text:
                yield f"{section}: {key}: {text}"


def test_public_docstrings_have_a_summary_and_every_parameter():
    assert [f"{name}: {x}" for name in DOCUMENTED for x in faults(name)] == []


ROOT = Path(__file__).parents[1]


def test_defaults_of_compensation_are_those_of_its_page():
    page = (ROOT / "docs/guides/compensations.md").read_text(encoding="utf-8")
    default, of_bodies = re.findall(r"\| `(\w+)`, \*\*the default", page)
    assert of_bodies == ac.InverseDynamics.method
    arm = ac.load_arm("pmk3s")
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    plan = ac.plan(ac.JointPath.spline([(0.1, 1.0), (0.2, 1.1), (0.5, 1.0)]), arm)
    for arm_argument in (arm, None):
        assert ac.compensate(plan, servo, arm=arm_argument).method == default


# Facts that are printed, by the class of the result.
FACTS = {
    "Certificate": ("servo 0.00418 mm", "2 mm", "of 0.1 mm"),
    "Check": ("joint_acceleration", "rad/s²", "kept"),
    "Evaluation": ("motion 2.19 s", "contour error, RMS"),
    "Explanation": ("joint 2 acceleration", "%"),
    "JobResult": ("only", "2.19 s"),
    "Placement": ("best place", "x 0 mm", "out of reach"),
    "Limits": ("joint_torque", "28 N m"),
}


def results():
    job = parse_job(CORNER_JOB)
    job_result = ac.run(job)
    x = job_result.runs["only"]
    certificate = ac.certify(job)
    check = ac.check(x.trajectory, job.arm, x.run.limits)
    yield from (job, job_result, x, certificate, certificate.worst, check, check.worst, job.arm)
    yield from (x.evaluation, x.evaluation.contour_error, x.explanation)
    grid = {"x": np.array([0.0, 0.01])}
    places = [Place(values={"x": x}, duration=1.5, refusal="") for x in (0.0, 0.01)]
    yield Placement(
        job=job, run=job.runs[0], axes=grid, moved="part", about=np.zeros(3),
        places=tuple(places), own=Place(values={}, refusal="reach", why_not="It is out of reach."),
    )  # fmt: skip
    done = BatchRow(job=1, values={}, status="done", run="only", data=x.to_data())
    refused = BatchRow(job=2, values={}, status="refused", data=Data(""), error="It is slow.")
    yield Batch(title="job.yaml: 2 jobs", rows=(done, refused))
    yield dataclasses.replace(ac.load_arm("ur5e").limits, speed=0.25)


def test_printed_results_have_few_lines_and_their_repr_has_one():
    for result in results():
        name = type(result).__name__
        text = " ".join(str(result).split())
        lines = str(result).splitlines()
        assert len(lines) <= MAX_LINES + 2 and max(map(len, lines)) < 100, name
        assert all(x in text for x in FACTS.get(name, ())), text
        assert_one_line(result)


def assert_one_line(result):
    text = repr(result)
    assert "\n" not in text and len(text) < 1000 and type(result).__name__ in text


def test_the_repr_of_values_is_one_line():
    x = ac.run(parse_job(CORNER_JOB)).runs["only"]
    t = np.linspace(0.0, 1.0, 251)[:, None]
    program = ac.Program.from_path(ac.Path.polyline([[0, 0], [0.1, 0]]))
    for value in (x.execution, x.traced.joint_paths[0], x.path.path, x.set_points, x.trajectory):
        assert_one_line(value)
    for value in (x.trajectory.sample(0.1), program, ac.Log(t=t[:, 0], command=t, measured=t)):
        assert_one_line(value)


def test_texts_from_files_are_escaped_on_the_terminal():
    text = format_table("a\x1b[2J", [("b\nc", "d\x07")])
    assert text.splitlines() == ["a\\x1b[2J", "  b\\nc  d\\x07"]
