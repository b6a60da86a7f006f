"""Job files: what they give, and how a bad one is refused."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path as FilePath
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml
from docs.reference.job_keys import published
from soak.number_cases import PLANE

from armcontour import load_arm
from armcontour.cli.running import built_in_job
from armcontour.compensation import compensator
from armcontour.errors import InvalidInput
from armcontour.io import json_schema, parse_job, read_job
from armcontour.jobs import Rounding
from armcontour.timing import methods

ROOT = FilePath(__file__).parents[2]
GOOD = {
    "name": "bracket",
    "arm": "pmk3s",
    "path": {"points": [["300 mm", 0.20], [0.40, 0.20], [0.40, 0.30]]},
    "limits": {"speed": "0.10 m/s", "centripetal_acceleration": 0.09},
    "corners": {"tolerance": "2 mm"},
    "servo": {"kp": "25 1/s", "kv": 150},
    "runs": {"one": {"timing": {"method": "mac"}}},
}


def with_change(place: str, value: object) -> str:
    """The good job as text, with one key changed; None removes it."""
    data = json.loads(json.dumps(GOOD))
    *keys, last = place.split(".")
    inner = data
    for key in keys:
        inner = inner.setdefault(key, {})
    if value is None:
        inner.pop(last)
    else:
        inner[last] = value
    return yaml.safe_dump(data)


def test_a_good_job_is_read_in_si_units() -> None:
    job = parse_job(yaml.safe_dump(GOOD))
    assert job.arm.name == "PMK-3s"
    np.testing.assert_array_equal(job.path.vertices, [[0.3, 0.2], [0.4, 0.2], [0.4, 0.3]])
    (run,) = job.runs
    assert (run.timing, run.compensation, run.period) == (
        "mac",
        "pole_placement",
        4e-3,
    )
    assert run.limits.speed == 0.10
    assert run.rounding is not None
    assert run.rounding.tolerance == 2e-3
    np.testing.assert_array_equal(job.servo.kp, [25, 25])


@pytest.mark.parametrize(
    ("given", "experiment", "expected"),
    [
        ({}, None, True),
        ({}, {}, True),
        ({}, {"gravity_feedforward": False}, False),
        ({}, {"gravity_feedforward": False, "runs": []}, True),
        ({"gravity_feedforward": False}, {}, False),
    ],
)
def test_gravity_is_fed_forward_as_in_the_experiment(given, experiment, expected) -> None:
    compensation = {"method": "inverse_dynamics", **given}
    runs = {"one": {"compensation": compensation}}
    text = yaml.safe_dump({**GOOD, "runs": runs, "experiment": experiment})
    (run,) = parse_job(text).runs
    assert run.compensation_options == {"gravity_feedforward": expected}


def test_a_run_takes_from_the_job_what_it_does_not_say() -> None:
    run = {
        "timing": {"method": "conventional"},
        "limits": {"speed": "40 mm/s"},
        "corners": "sharp",
        "command_interval": "1 ms",
        "until": "3 s",
    }
    (found,) = parse_job(with_change("runs", {"slow": run})).runs
    assert found.limits.speed == 0.04
    assert found.limits.centripetal_acceleration == 0.09
    assert found.rounding is None
    assert (found.period, found.until) == (1e-3, 3.0)


def test_the_acceleration_of_case_one_limits_the_corner_speed_too() -> None:
    text = with_change("corners", {"speed": "0.03 m/s", "acceleration": "0.05 m/s^2"})
    assert parse_job(text).runs[0].limits.centripetal_acceleration == 0.09
    without = text.replace("centripetal_acceleration: 0.09", "{}")
    job = parse_job(without.replace("  {}\n", ""))
    assert job.runs[0].limits.centripetal_acceleration == 0.05


def test_null_lifts_a_limit_of_the_arm_or_of_the_job() -> None:
    arm = load_arm("pmk3s")
    assert arm.limits.joint_acceleration is not None
    assert parse_job(yaml.safe_dump(GOOD)).runs[0].limits.joint_acceleration is not None
    lifted = with_change("limits.joint_velocity", 2.0).replace("0.10 m/s", "0.10 m/s\n  Z: null")
    (run,) = parse_job(lifted.replace("Z", "joint_acceleration")).runs
    assert run.limits.joint_acceleration is None
    np.testing.assert_array_equal(run.limits.joint_velocity, [2, 2])
    runs = {"one": {"limits": {"speed": None, "joint_acceleration": None}}, "two": {}}
    one, two = parse_job(with_change("runs", runs)).runs
    assert one.limits.speed is None and one.limits.joint_acceleration is None
    assert two.limits.speed == 0.10 and two.limits.joint_acceleration is not None


def test_the_plant_is_the_servo_but_for_what_it_says() -> None:
    job = parse_job(with_change("plant", {"dead_time": "44 ms"}))
    np.testing.assert_array_equal(job.plant_servo.kp, job.servo.kp)
    np.testing.assert_array_equal(job.plant_servo.kv, job.servo.kv)
    np.testing.assert_array_equal(job.plant_servo.dead_time, [0.044, 0.044])
    np.testing.assert_array_equal(job.servo.dead_time, [0, 0])
    first = parse_job(with_change("plant", {"order": "first"})).plant_servo
    assert first.order == "first" and first.kv is None
    assert parse_job(with_change("plant", {})).plant_servo.order == "second"


def test_methods_are_those_of_the_doors() -> None:
    kinds = json_schema()["$defs"]
    for name, known in (("Timing", methods.METHODS), ("Compensation", compensator.METHODS)):
        assert kinds[f"{name}Model"]["properties"]["method"]["enum"] == list(known)


def test_lines_and_arcs() -> None:
    path = {
        "start": [0.28, 0.20],
        "segments": [
            {"to": [0.40, 0.20], "speed": "50 mm/s"},
            {"center": [0.40, 0.23], "angle": "180 deg", "tag": "bend"},
        ],
    }
    job = parse_job(with_change("path", path))
    np.testing.assert_allclose(job.path.vertices[-1], [0.40, 0.26], atol=1e-15)
    assert job.path.speeds[0] == 0.05
    assert job.path.tags == (None, "bend")


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("arm", None, "the key arm is missing"),
        ("arm", "pmk4", "no built-in arm 'pmk4'"),
        ("limits.speeed", 1, r"unknown key limits.speeed: did you mean speed\?$"),
        ("corners.tolerence", 1, r"unknown key corners.tolerence: did you mean tolerance\?$"),
        ("runs.one.limits.sped", 1, r"runs.one.limits.sped: did you mean speed\?$"),
        ("servo.colour", 1, "unknown key servo.colour: the keys there are kp, kv, order, "),
        (
            "runs.one.servo",
            {"kp": "50 1/s"},
            "runs.one.servo: servo is of the whole job, .* batch`",
        ),
        ("corners", {"tolerance": 0, "2 mm": None}, "unknown key corners.2 mm: a comma between"),
        ("servo", "", "servo: must be a mapping of keys, not ''.$"),
        ("corners", {}, "corners needs tolerance, the largest corner error, or speed and acceler"),
        ("runs.one.corners", {"acceleration": 1}, "runs.one.corners needs tolerance"),
        ("corners", "round", "corners: must be a mapping of keys or sharp, not 'round'.$"),
        ("corners", {"shape": "round"}, "corners.shape: must be arc or free, not 'round'.$"),
        ("corners", {"zone": "2 mm"}, "Run one: corners.zone is for the shape free"),
        ("corners.tolerance", "-2 mm", "corners.tolerance: must not be negative, but is -2 mm.$"),
        ("corners.iterations", 1.5, "corners.iterations: must be a whole number, not 1.5.$"),
        (
            "runs.one.corners",
            {"shape": "free", "tolerance": "1 mm"},
            "runs.one.corners.shape is free, which .* but this run has the method mac: ",
        ),
        (
            "runs.one",
            {"corners": {"shape": "free"}},
            "runs.one.corners.tolerance is missing: the shape free needs it, ",
        ),
        (
            "runs.one.timing.method",
            "shaped",
            r"timing.method: shaped is no timing of a job: write corners: {shape: free, toler",
        ),
        ("runs.one", [], r"runs.one: must be a mapping of keys, not \[\].$"),
        ("runs.one.timing.method", "fast", "runs.one.timing.method: must be optimal, mac or conv"),
        (
            "runs.one.compensation",
            {"method": "full"},
            "method: must be inverse, pole_placement, inverse_dynamics or",
        ),
        (
            "runs.one.compensation",
            {"poles": [-1, -1]},
            "poles: needs at least 3 entries, but has 2",
        ),
        (
            "runs.one.compensation",
            {"poles": [-1, -1, 1]},
            r"\(item 3\): must be below zero, but is 1",
        ),
        (
            "runs.one.compensation",
            {"method": "inverse", "poles": [-1, -1, -1]},
            "runs.one.compensation.poles goes with the method pole_placement, not inverse.$",
        ),
        (
            "runs.one.compensation",
            {"method": "inverse", "gravity_feedforward": False},
            "compensation.gravity_feedforward goes with the method inverse_dynamics, not inverse.$",
        ),
        ("runs.one.timing.intervals", 50, "timing.intervals goes with the method optimal, not mac"),
        ("runs.one.timing.knots", 1, "runs.one.timing.knots: must be at least 8, but is 1.$"),
        ("runs.one.limits", {"speed": 0}, "runs.one.limits.speed: must be above zero"),
        ("command_interval", "0 s", "command_interval: must be above zero, but is 0 s.$"),
        ("plant", {"kp": "-1 1/s"}, "plant.kp: must be above zero"),
        ("plant", {"kp": [1, 2, 3]}, "plant: servo gain kp has 3 values"),
        ("title", 5, "title: must be text, not 5.$"),
        ("path.points", 5, "path.points: must be a list, not 5.$"),
        ("limits.speed", "0.1", "limits.speed: '0.1' has no unit"),
        ("limits.speed", "5 mm", "limits.speed: must be a quantity in m/s"),
        ("limits.speed", -1, "limits.speed: must be above zero, but is -1 m/s"),
        ("limits.joint_acceleration", -0.72, "limits.joint_acceleration: must be above zero"),
        ("limits.joint_acceleration", [1, 2, 3], "joint_acceleration has 3 values.*2 joints"),
        ("path.points", [[0.3, 0.2]], "at least two different points"),
        ("path.points", [[0.3, 0.2], [0.3, 0.2]], "all the same"),
        ("path.points", [], "points of path are empty"),
        (
            "path.points",
            [[0.3, float("nan")], [0.3, 0.2]],
            r"path.points \(item 1, item 2\): must be finite",
        ),
        ("path.points", [[0.3, 0.2], [0.3, 0.2, 0.1]], "all have 2 or all have 3"),
        ("path.start", [0, 0], "either points, or start and segments"),
        ("servo.kp", [25, 20, 10], "servo: servo gain kp has 3 values, but the arm has 2"),
        ("servo.kp", 0, "servo.kp: must be above zero, but is 0 1/s"),
        ("servo.interpolation", "quartic", "servo.interpolation"),
        ("servo.dead_time", "-1 ms", "servo.dead_time: must not be negative, but is -1 ms"),
        ("servo.order", "first", "leave its gain kv out"),
        ("runs", {}, "runs: needs at least one entry, but has 0.$"),
        ("runs", {"../up": {}}, "runs.../up: a name must be letters, digits, - and _, 64 at most"),
        ("published", {"source": "x", "runs": {"two": {}}}, "names the run two"),
        (
            "published",
            {"source": "x", "runs": {"one": {"duration": "5 mm"}}},
            "must be a quantity in s",
        ),
    ],
)
def test_a_bad_job_is_refused_in_one_sentence(place: str, value: object, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        parse_job(with_change(place, value), source="bracket.yaml")
    assert str(caught.value).startswith("bracket.yaml: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not valid YAML: .*line 1"),
        ("- 1", "must hold a mapping"),
        ("", "must hold a mapping"),
        ("name: a\nname: b", "'name' stands twice"),
        ("[" * 20000, "nested too deeply"),
        (
            "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
            + "".join(
                f"{y}: &{y} [{', '.join(['*' + x] * 10)}]\n"
                for x, y in zip("abcdefgh", "bcdefghi", strict=True)
            ),
            "fewer aliases",
        ),
        ("a: 2024-99-99", "not valid YAML|unknown key|missing"),
    ],
)
def test_a_file_that_is_no_job(text: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        parse_job(text)


def test_corners_of_the_shape_free() -> None:
    corners = {"shape": "free", "tolerance": "5 mm", "line_tolerance": "0.1 mm", "zone": "20 mm"}
    found = parse_job(with_change("runs.one", {"corners": {**corners, "iterations": 7}})).runs[0]
    assert found.timing == "optimal" and found.rounding == Rounding(
        shape="free", tolerance=5e-3, line_tolerance=1e-4, zone=0.02, iterations=7
    )
    assert parse_job(with_change("corners", {"tolerance": "5 mm"})).runs[0].rounding == Rounding(
        tolerance=5e-3
    )


def test_numbers_with_an_exponent_are_numbers() -> None:
    text = with_change("corners.tolerance", "X").replace("X", "2e-3")
    assert parse_job(text).runs[0].rounding.tolerance == 2e-3  # type: ignore[union-attr]


def test_a_file_that_is_not_there(tmp_path: FilePath) -> None:
    with pytest.raises(InvalidInput, match="There is no job file"):
        read_job(tmp_path / "none.yaml")


def test_an_arm_file_is_found_beside_the_job(tmp_path: FilePath) -> None:
    arm = (ROOT / "src/armcontour/io/robots/library/pmk3s.yaml").read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(arm.replace("PMK-3s", "mine"), encoding="utf-8")
    (tmp_path / "job.yaml").write_text(with_change("arm", "mine.yaml"), encoding="utf-8")
    assert read_job(tmp_path / "job.yaml").arm.name == "mine"


def test_what_is_published_of_the_keys_is_what_is_in_use() -> None:
    found = published()
    assert {x.name for x in found} == {"job.schema.json", "job_keys.md"}
    for file, text in found.items():
        assert file.read_text(encoding="utf-8") == text, f"make schema rewrites {file.name}"


def test_every_key_has_a_line_with_value_unit_and_what_it_holds() -> None:
    page = next(text for file, text in published().items() if file.name == "job_keys.md")
    rows = [x.strip("|").split(" | ") for x in page.splitlines() if x.startswith("| `")]
    assert {len(x) for x in rows} == {5}
    lines = Counter(x[0].strip(" `") for x in rows)
    kinds = [json_schema(), *json_schema()["$defs"].values()]
    keys = Counter(key for kind in kinds for key in kind.get("properties", {}))
    assert len(keys) > 80 and lines == keys
    assert [key for key, value, _, _, text in rows if not value or len(text.split()) < 2] == []
    quantities = [x for x in rows if re.search(r"`-?[\d.e]+ \S+`", x[1])]
    assert len(quantities) > 60 and [key for key, _, unit, *_ in quantities if not unit] == []


def test_the_schema_accepts_what_is_accepted_and_refuses_an_unknown_key() -> None:
    jsonschema.Draft202012Validator.check_schema(json_schema())
    validator = jsonschema.Draft202012Validator(json_schema())
    text = (ROOT / "src/armcontour/jobs/library/paper.yaml").read_text(encoding="utf-8")
    assert list(validator.iter_errors(yaml.safe_load(text))) == []
    assert list(validator.iter_errors(GOOD)) == []
    assert list(validator.iter_errors({**GOOD, "speeed": 1}))


def test_the_built_in_job_is_the_papers() -> None:
    job = built_in_job()
    assert [x.name for x in job.runs] == [
        "conventional",
        "uncompensated",
        "proposed",
        "optimal",
        "inverse-dynamics",
        "shaped",
    ]
    assert job.published is not None
    assert job.published.runs["proposed"]["contour_error_rms"] == pytest.approx(0.164e-3)
    assert job.published.time_stamps[-1] == 5.770


@pytest.mark.parametrize("key", ["a[b", "path(1", "name:j/[{kS", "float", "ArmModel"])
def test_an_unknown_key_is_named_whatever_it_looks_like(key: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        parse_job(with_change(key, 1))
    assert f"unknown key {key}: " in str(caught.value)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (
            {"points": [[0, 0], [0, "1e308 m"]]},
            r"path.points \(item 2, item 2\): must be between .* 1e\+12 m, but is 1e308 m",
        ),
        ({"spline": {"points": [[0, 0], [0, 1], [2e6, 1]]}}, r"path.spline.points \(item 3\) has"),
        ({"start": [-1e11, 0], "segments": [{"to": [0, 1]}]}, "path.start has a coordinate"),
        (
            {"start": [0, 0], "segments": [{"to": [0, 1]}, {"via": [1e10, 0], "to": [0, 2]}]},
            r"path.segments \(item 2\).via has a coordinate of 1e\+10 m, beyond 1e\+06 m",
        ),
    ],
)
def test_points_that_are_too_far_away_are_refused(path: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        parse_job(with_change("path", path))


@pytest.mark.parametrize(
    ("given", "windows"), [("20 ms", (0.02,)), (["20 ms", 0.01], (0.02, 0.01)), (None, ())]
)
def test_windows_of_smoothing(given, windows) -> None:
    (run,) = parse_job(with_change("runs", {"one": {"smoothing": given}})).runs
    assert run.smoothing == windows


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], "needs at least one entry, but has 0"),
        (["20 ms"] * 3, "takes at most 2 entries, but has 3"),
        ("0 ms", ""),
        (-0.01, ""),
        ("20 mm", ""),
        (["x"], "'x' is not a quantity in s"),
    ],
)
def test_windows_that_cannot_be(given, words) -> None:
    with pytest.raises(InvalidInput, match=rf"runs.one.smoothing.*{words}"):
        parse_job(with_change("runs", {"one": {"smoothing": given}}))


def test_a_reserve_of_ten_is_ten_percent() -> None:
    with pytest.raises(InvalidInput) as caught:
        parse_job(yaml.safe_dump(PLANE | {"runs": {"one": {"timing": {"reserve": 10}}}}))
    assert str(caught.value) == (
        "job: runs.one.timing.reserve: must be from 0 to below 1, which is 100 %, but is 10: for "
        "10 percent write 10 %."
    )
