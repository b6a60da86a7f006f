"""Figures and the picture of a full run."""

import numpy as np
import pytest
import yaml
from tests.studio.tasks.asking import ask

from armcontour.io import parse_job
from armcontour.jobs import run
from armcontour.studio.tasks.figures import OTHER_CONFIGURATION

GASKET = """
name: gasket
arm: {name: ur5e, work: {position: [400 mm, -100 mm, 100 mm]}}
path:
  file: gasket.dxf
  names: [handle 31, handle 33]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 0.2 m/s}
corners: {tolerance: 0.5 mm}
servo: {kp: 25, kv: 150}
command_interval: 8 ms
runs: {cut: {}}
"""


@pytest.mark.parametrize("which", ["coarse", "square", "gasket"])
def test_they_are_those_of_a_run_of_the_saved_job(which, drawings, request):
    data = GASKET if which == "gasket" else request.getfixturevalue(which)
    text = data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False)
    study = run(parse_job(text, folder=drawings))
    for name, result in study.runs.items():
        found, e = ask("figures", text, name, drawings).header, result.evaluation
        for key, value in (
            ("duration", e.duration),
            ("settled", e.settled),
            ("rms", e.contour_error.rms),
            ("max", e.contour_error.max),
            ("objective_max", e.objective_error.max),
            ("missed", e.missed.max),
        ):
            assert found[key] == pytest.approx(value, abs=1e-9), key
        assert found["warnings"] == result.warnings
        executed = result.execution
        held = zip(executed.arm.joint_names, executed.saturated_time.tolist(), strict=True)
        told = [(x["joint"], x["time"]) for x in found["saturated"]]
        assert told == [x for x in held if x[1] > 0]
        if result.clearance is not None:
            least = result.clearance.least
            assert found["clearance"]["least"] == pytest.approx(least.high, abs=1e-9)


def test_a_collision_is_a_refusal_where_it_is(square, drawings):
    box = {"name": "post", "size": [0.02, 0.02, 0.1], "at": [0.1, 0.1, 0.0]}
    square["scene"] = {"boxes": [box | {"fixed_to": "part"}]}
    square["start"] = [0.0, -1.5, 1.5, -1.5, -1.5, 0.0]
    frame = ask("figures", square, "optimal", drawings)
    assert (frame.kind, frame.header["tier"]) == ("refusal", 3)
    assert frame.header["error"] == "Collision" and frame.header["exit"] == 8
    assert "post" in frame.header["sentence"]
    assert abs(frame.header["at"]["uv"] - np.array([0.1, 0.1])).max() < 0.02
    assert frame.header["at"]["t"] >= 0


def test_data_that_make_no_job_are_refused(square, drawings):
    del square["servo"]
    frame = ask("figures", square, "optimal", drawings)
    assert frame.kind == "refusal" and "servo" in frame.header["sentence"]


def test_another_configuration_is_said(line, drawings):
    start = np.array(ask("figures", line, "optimal", drawings).header["start"])
    for more, says in ((0.0, False), (0.5, True)):
        found = ask("figures", line, "optimal", drawings, start=(start + more).tolist())
        assert (OTHER_CONFIGURATION in found.header["notes"]) is says


def test_the_plan_of_a_full_run_has_a_picture(coarse, drawings):
    found = ask("plan", coarse, "optimal", drawings)
    assert found.kind == "picture" and found.header["planned"]
