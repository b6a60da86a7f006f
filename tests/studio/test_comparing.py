"""Comparison of runs: exact figures of those that are not shown, and keys in which they differ."""

import numpy as np
import pytest
import yaml
from tests.studio.conftest import DRAWINGS
from tests.studio.session_pages import JOB, RecordingTaskWorker, figure

import armcontour as ac
from armcontour.core.yaml_loader import load
from armcontour.files import parse_job
from armcontour.studio.run_keys import differing_keys
from armcontour.studio.tasks.dispatch import do


def compare(text, *runs):
    request = {"text": text, "folder": str(DRAWINGS), "run": "fast", "options": {"runs": [*runs]}}
    frame = do("compare", request, lambda step: None)
    assert frame.kind == "result"
    return frame.header["runs"]


def test_compared_runs_have_the_figures_of_a_run_of_the_job():
    results = ac.run(parse_job(JOB)).runs
    compared = compare(JOB, "fast", "slow")
    assert [x["run"] for x in compared] == ["fast", "slow"]
    for header in compared:
        evaluation = results[header["run"]].evaluation
        assert figure(header, "duration") == pytest.approx(evaluation.duration, abs=1e-9)
        error = evaluation.contour_error.max
        assert figure(header, "contour_error.max") == pytest.approx(error, abs=1e-9)
        assert figure(header, "kept") in (True, False)


def test_a_run_that_fails_says_why_and_the_others_are_planned():
    data = load(JOB, "")
    # No motion is as short as this.
    data["runs"]["slow"] = {"duration": "0.01 s"}
    failed, planned = compare(yaml.safe_dump(data, sort_keys=False), "slow", "fast")
    assert failed["run"] == "slow" and "rows" not in failed
    assert "duration" in failed["sentence"]
    assert np.isfinite(figure(planned, "duration"))


def test_unknown_runs_are_not_compared():
    for runs in (["none"], [["fast"]]):
        with pytest.raises(ac.InvalidInput, match="names of runs"):
            compare(JOB, *runs)


def keys_of(text):
    return {x["key"]: x["values"] for x in differing_keys(load(text, ""))}


def test_keys_in_which_runs_differ_have_the_values_that_apply():
    text = """\
limits: {speed: 100 mm/s, joint_acceleration: 2}
cycle: 4 ms
runs:
  a: {}
  b: {limits: {speed: 60 mm/s}, cycle: 8 ms, compensation: {method: none}}
  c: {limits: {joint_acceleration: 3}, timing: {method: paper}, corners: {tolerance: 1 mm}}
"""
    assert keys_of(text) == {
        "limits.speed": {"a": "100 mm/s", "b": "60 mm/s", "c": "100 mm/s"},
        "limits.joint_acceleration": {"a": "2", "b": "2", "c": "3"},
        "cycle": {"a": "4 ms", "b": "8 ms", "c": "4 ms"},
        "compensation.method": {"a": "default", "b": "none", "c": "default"},
        "timing.method": {"a": "optimal", "b": "optimal", "c": "paper"},
        "corners.shape": {"a": "sharp", "b": "sharp", "c": "arc"},
        "corners.tolerance": {"c": "1 mm"},
    }


@pytest.mark.parametrize(
    "text",
    [
        "runs: {only: {limits: {speed: 1}}}",
        "runs: {a: {cycle: 4 ms}, b: {cycle: 0.004}}",
        "{cycle: 4 ms, runs: {a: {}, b: {cycle: 4 ms}}}",
        "{corners: sharp, runs: {a: {}, b: {}}}",
        "runs: none",
        "{}",
    ],
)
def test_runs_with_equal_keys_do_not_differ(text):
    assert keys_of(text) == {}


def test_the_page_starts_the_comparison_as_a_task(session, tab):
    header = tab.last("document")
    assert {x["key"] for x in header["run_keys"]} == {"limits.speed"}
    tab.say("task", id="c", task="compare", options={"runs": ["slow"]})
    assert RecordingTaskWorker.last.given[-1][:2] == ("c", "compare")
    assert RecordingTaskWorker.last.given[-1][2]["options"] == {"runs": ["slow"]}
