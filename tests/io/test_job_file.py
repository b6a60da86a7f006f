"""Job files: what they give, and how a bad one is refused."""

from __future__ import annotations

import json
from pathlib import Path as FilePath

import jsonschema
import numpy as np
import pytest
import yaml

from armcontour.cli.running import built_in_job
from armcontour.errors import InvalidInput
from armcontour.io import json_schema, parse_job, read_job

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
        ("limits.speeed", 1, "unknown key limits.speeed"),
        ("limits.speed", "0.1", "limits.speed: '0.1' has no unit"),
        ("limits.speed", "5 mm", "limits.speed: must be a quantity in m/s"),
        ("limits.speed", -1, "speed must be above zero, but is -1"),
        ("limits.joint_acceleration", -0.72, "joint_acceleration must be above zero"),
        ("limits.joint_acceleration", [1, 2, 3], "joint_acceleration has 3 values.*2 joints"),
        ("path.points", [[0.3, 0.2]], "at least two different points"),
        ("path.points", [[0.3, 0.2], [0.3, 0.2]], "all the same"),
        ("path.points", [], "points of path are empty"),
        ("path.points", [[0.3, float("nan")], [0.3, 0.2]], "path.points.0.1: must be finite"),
        ("path.points", [[0.3, 0.2], [0.3, 0.2, 0.1]], "all have 2 or all have 3"),
        ("path.start", [0, 0], "either points, or start and segments"),
        ("servo.kp", [25, 20, 10], "kp has 3 values, but the arm has 2 joints"),
        ("servo.kp", 0, "kp must be above zero"),
        ("servo.interpolation", "quartic", "servo.interpolation"),
        ("servo.dead_time", "-1 ms", "dead_time must not be negative"),
        ("servo.order", "first", "leave its gain kv out"),
        ("runs", {}, "runs"),
        ("runs", {"../up": {"timing": {"method": "mac"}}}, "runs"),
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


def test_numbers_with_an_exponent_are_numbers() -> None:
    text = with_change("corners.tolerance", "X").replace("X", "2e-3")
    assert parse_job(text).runs[0].rounding.tolerance == 2e-3  # type: ignore[union-attr]


def test_a_file_that_is_not_there(tmp_path: FilePath) -> None:
    with pytest.raises(InvalidInput, match="Cannot read the job file .*No such file"):
        read_job(tmp_path / "none.yaml")


def test_an_arm_file_is_found_beside_the_job(tmp_path: FilePath) -> None:
    arm = (ROOT / "src/armcontour/arms/library/pmk3s.yaml").read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(arm.replace("PMK-3s", "mine"), encoding="utf-8")
    (tmp_path / "job.yaml").write_text(with_change("arm", "mine.yaml"), encoding="utf-8")
    assert read_job(tmp_path / "job.yaml").arm.name == "mine"


def test_the_published_schema_is_the_one_in_use() -> None:
    file = ROOT / "docs" / "reference" / "job.schema.json"
    assert json.loads(file.read_text(encoding="utf-8")) == json_schema()


def test_the_schema_accepts_what_is_accepted_and_refuses_an_unknown_key() -> None:
    validator = jsonschema.Draft202012Validator(json_schema())
    text = (ROOT / "src/armcontour/study/library/paper.yaml").read_text(encoding="utf-8")
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
    ]
    assert job.published is not None
    assert job.published.runs["proposed"]["contour_error_rms"] == pytest.approx(0.164e-3)
    assert job.published.time_stamps[-1] == 5.770
