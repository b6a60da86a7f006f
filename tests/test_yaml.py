"""Hostile YAML, YAML 1.2 values, and limits on the number of values."""

import dataclasses
import math

import numpy as np
import pytest
import yaml
from tests.files.tables import refusals
from tests.properties.number_cases import PLANE, put

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.core.yaml_loader import MAX_YAML_LENGTH, load
from armcontour.files import parse_job
from armcontour.files.job_file import read_cell
from armcontour.jobs import Experiment, run


def chain(first, rest, count):
    """Lines, each of which names the one before."""
    lines = [rest.format(now=i, before=i - 1) for i in range(1, count)]
    return "\n".join([first, *lines])


MERGES = chain("a0: &a0 {x0: 1}", "a{now}: &a{now} {{<<: [*a{before}, *a{before}], x{now}: 1}}", 40)
NINE = ", ".join(["*a{before}"] * 9)
LISTS = chain("a0: &a0 [1, 1]", f"a{{now}}: &a{{now}} [{NINE}]", 40)
PAIRS = chain("a0: &a0 [1]", f"a{{now}}: &a{{now}} !!pairs [{{{{x: [{NINE}]}}}}]", 40)
HOSTILE = {
    "merges": (MERGES, "fewer aliases"),
    "many merges": (
        "a: &a {" + ", ".join(f"x{i}: 1" for i in range(2000)) + "}\n"
        "b: {<<: [" + ", ".join(["*a"] * 2000) + "]}",
        "fewer aliases",
    ),
    "aliases": (LISTS, "fewer aliases"),
    "pairs": (PAIRS, "fewer aliases"),
    "text": ('a: &a "' + "x" * 100_000 + '"\nb: [' + "*a, " * 1000 + "]", "fewer aliases"),
    "itself": ("a: &a [1, *a]", "an alias is inside its own anchor"),
    "merges itself": ("a: &a {<<: *a}", "an alias is inside its own anchor"),
    "sixties": (
        "a: !!float " + "59:" * 100_000 + "59.5",
        "finite number of at most 100 characters",
    ),
    "whole sixties": ("a: !!int " + "59:" * 100_000 + "59", "not a finite number"),
    "a short one": ("a: !!float 59:59.5", "is not a finite number"),
    "digits": ("a: " + "9" * 5000, "finite number of at most 100 characters"),
    "hundred thousands of digits": (
        "a: " + "9" * 300_000,
        "finite number of at most 100 characters",
    ),
    "too large": ("a: 1e999", "not a finite number"),
    "no angle": ("a: !!int 1_000", "not a finite number"),
    "flow": ("[" * 100_000, "nested too deeply"),
    "block": ("- " * 100_000, "nested too deeply"),
    "keys": ("? " * 10_000, "nested too deeply"),
    "size": (
        "#" * (MAX_YAML_LENGTH + 1),
        "16 million characters, more than the limit of 16 million",
    ),
    "object": ("a: !!python/object:os.system 1", "could not determine a constructor"),
    "tag": ("a: !" + "x" * 100_000 + " 1", "could not determine a constructor"),
    "alias of nothing": ("a: *" + "x" * 100_000, "found undefined alias"),
    "escapes": ('"\\e]52;c;cA==\\e": 1\n"\\e]52;c;cA==\\e": 1', "is repeated"),
}


MISTAKES = {
    "name: a\ntitle: 'open\nb: 1\n": "the quote that begins in line 2 does not end ... (line 4,",
    "a:\n\tb: 1\n": "indent with blanks instead of a tab ... (line 2, column 1)",
    "a:\n   b: 1\n  c: 2\n": "not indented like the lines around it ... (line 3, column 3)",
    "a: {b: 1}}\n": "a bracket too many (line 1, column 10)",
    "x: 1\na: {b: 1\nc: 2\n": "the bracket of line 2 needs ... (line 3, column 2)",
    "a:\n  b: 1\n   c: 2\n": "this colon is wrong ... the line is indented too far ... (line 3,",
    "a: 5\nb 6\n": "line 2 has no colon after its key (line 3, column 1)",
    "limits: {a: 1, a: 2}": "the key 'a' is repeated (line 1, column 16)",
}


def test_typing_errors_are_explained_with_their_line():
    refusals(lambda text: load(text, "x"), MISTAKES.items(), "x is not valid YAML: ")


# The limits end these readings early; without them they would not end, or run out of memory.
@pytest.mark.parametrize("names", [list(HOSTILE)[::2], list(HOSTILE)[1::2]])
def test_hostile_texts_are_refused_in_one_sentence(names):
    for name in names:
        text, words = HOSTILE[name]
        with pytest.raises(InvalidInput) as caught:
            load(text, "x")
        message = str(caught.value)
        assert words in message, name
        assert message.startswith("x ") and message.isprintable() and len(message) <= 2000, name


def test_handwritten_texts_are_read_as_yaml_1_2():
    for end in ("!", "e", "e5!", "_", ":1"):
        text = "9" * 300_000 + end
        assert load(f"a: {text}", "job.yaml") == {"a": text}
    text = "[0, 010, -5, +5, 1., .5, 1e3, -1.5E-3, 1:30, 1_000, 0x10, 0b1, 2026-01-01, 1e, '5']"
    expected = [0, 10, -5, 5, 1.0, 0.5, 1e3, -1.5e-3, "1:30", "1_000", "0x10", "0b1", "2026-01-01"]
    values = load(text, "x")
    assert values == [*expected, "1e", "5"]
    assert [type(x) for x in values[:8]] == [int] * 4 + [float] * 4
    endless = load("[.inf, -.INF, .nan]", "x")
    assert endless[:2] == [math.inf, -math.inf] and math.isnan(endless[2])
    text = "{off: 0, on: 1, yes: off, no: False, y: true}"
    assert load(text, "a") == {"off": 0, "on": 1, "yes": "off", "no": False, "y": True}
    assert load("[!degrees 90, !radians 1]", "a") == [math.pi / 2, 1]
    text = "a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}\nc: [*a, *a]\nd: {<<: [{z: 1}, *a]}"
    values = load(text, "x")
    assert values["b"] == {"x": 1, "y": 3} and values["c"] == [{"x": 1, "y": 2}] * 2
    assert values["d"] == {"x": 1, "y": 2, "z": 1}


def test_keys_override_those_that_they_merge_at_every_depth():
    text = (
        "a: &a {x: 1, y: 1, z: 1}\nb: &b {<<: *a, y: 2, z: 2}\nc: &c {<<: *b, z: 3}\n"
        "d: {<<: [{y: 4}, *c]}\ne: {<<: [*c, {y: 4}], '=': 5}"
    )
    data = load(text, "x")
    assert data["c"] == {"x": 1, "y": 2, "z": 3} and data["b"] == {"x": 1, "y": 2, "z": 2}
    assert data["d"] == {"x": 1, "y": 4, "z": 3}
    assert data["e"] == {"x": 1, "y": 2, "z": 3, "=": 5}


def test_yaml_merge_keys_require_mappings(refuses):
    for text in ("a: {<<: 1}", "a: {<<: [{b: 1}, [c]]}"):
        words = "takes a mapping or a list of mappings"
        refuses(lambda text=text: load(text, "x"), InvalidInput, words)


def job(**changes):
    """The small job in the plane, with values at keys with dots."""
    data = PLANE
    for place, value in changes.items():
        data = put(data, tuple(place.split("__")), value)
    return parse_job(yaml.safe_dump(data))


def teach_with_a_dwell_of_a_day(folder):
    file = folder / "part.ngc"
    file.write_text("G21 G90 G17\nG0 X10 Y10\nF600\nG1 X20 Y10\nG4 P99999\nG1 X20 Y20\nM2\n")
    job = read_cell("pmk3s", file)
    runs = tuple(dataclasses.replace(x, cycle=1e-3) for x in job.runs)
    run(dataclasses.replace(job, runs=runs), simulate=False)


def test_large_numbers_of_samples_are_refused(tmp_path):
    for call in (
        lambda: run(job(limits__speed=1e-6, cycle=1e-3), simulate=False).runs,
        lambda: teach_with_a_dwell_of_a_day(tmp_path),
    ):
        with pytest.raises(ac.InvalidInput, match="longer cycle") as caught:
            call()
        assert caught.value.needed > caught.value.allowed == 5e7
    with pytest.raises(ac.InvalidInput, match=r"Run one: At its assigned velocities.*Raise speed"):
        job(limits__speed=1e-12)


def test_numbers_out_of_range_are_refused():
    for interval in (1e9, 5e-324, 2e-7):
        with pytest.raises(ac.InvalidInput, match="must be from 1e-(06 to 1|30 to 1e\\+12) s"):
            job(cycle=interval)
    # A number without a unit is in seconds.
    for interval in (2, 8, 250.0):
        with pytest.raises(ac.InvalidInput, match=f"is {interval:g} s.*{interval:g} ms"):
            job(cycle=interval)
    for step in (1e-12, 1e-300, 5e-324, 1e-9, 1e9):
        with pytest.raises(ac.InvalidInput, match="must be from 1e-06 to 0.1 s"):
            Experiment(step=step)
    with pytest.raises(ac.InvalidInput, match=r"between -1e\+12 and 1e\+12 m, but is 1e\+300"):
        ac.Path.polyline([[1e300, 0.0], [0.0, 0.0]])
    with pytest.raises(ac.InvalidInput, match="speed of limits must be from 1e-30"):
        ac.Limits(speed=5e-324)
    with pytest.raises(ac.InvalidInput, match=r"joint_lower of limits must be from -1e\+12"):
        ac.Limits(joint_lower=np.array([-1e300]))
