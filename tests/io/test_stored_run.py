"""Runs of earlier results: the derivatives of their set-points."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path as FilePath

import numpy as np
import pytest

import armcontour as ac
from armcontour.io.exports import make_table
from armcontour.io.motion_csv import write_planned, write_taught
from armcontour.io.results import SUMMARY, ResultFolder
from armcontour.io.stored_run import read_run

PERIOD = 0.004
ARM = ac.load_arm("pmk3s")


@pytest.mark.parametrize("method", ["none", "inverse"])
@pytest.mark.parametrize("derivatives", [1, 2])
def test_an_earlier_result_has_the_derivatives_that_its_run_had(
    method: str, derivatives: int, tmp_path: FilePath
) -> None:
    path = ac.Path.polyline([(0.35, 0.1), (0.36, 0.11)])
    planned = ac.plan(path, ARM, ac.Limits(joint_acceleration=0.72, joint_jerk=7.2))
    assert planned.duration % PERIOD > 1e-6
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    taught = ac.compensate(planned, servo, method=method, period=PERIOD)
    about = {
        "job": "line",
        "arm": {"joints": ARM.joint_names},
        "runs": {"a": {"period": PERIOD, "compensation": method}},
    }
    with ResultFolder(tmp_path / "out") as folder:
        names = ARM.joint_names
        folder.place(SUMMARY, lambda file: file.write_text(json.dumps(about)))
        folder.place("a/taught.csv", partial(write_taught, taught=taught, joint_names=names))
        folder.place(
            "a/planned.csv",
            partial(write_planned, x=planned.sample(PERIOD), joint_names=names),
        )
    found = read_run(tmp_path / "out").taught(derivatives=derivatives)
    expected = make_table(taught, name="x", derivatives=derivatives)
    np.testing.assert_array_equal(found.t, expected.t)
    assert found.dq is not None and expected.dq is not None
    np.testing.assert_allclose(found.dq, expected.dq, atol=2e-9)
    if derivatives == 2:
        assert found.ddq is not None and expected.ddq is not None
        # Set-points have 12 decimals in a result, the derivatives of a spline follow.
        atol = 1e-11 if method == "none" else 2e-6
        np.testing.assert_allclose(found.ddq, expected.ddq, atol=atol)
