"""Limits and distances that are judged."""

import pytest
from tests.studio.tasks.asking import ask


def test_a_check_has_a_row_per_limit(coarse, drawings):
    found = ask("check", coarse, "optimal", drawings).header
    assert found["verdict"] == "kept" and found["sentence"].startswith("All limits are kept.")
    rows = {x["limit"]: x for x in found["rows"]}
    assert rows["speed"]["ratio"] == pytest.approx(1, abs=1e-6)
    assert rows["speed"]["unit"] == "m/s"


def test_clearance_over_time_is_not_below_what_is_proven(square, drawings):
    found = ask("clearance", square, "optimal", drawings)
    assert found.header["kept"]
    sentence = found.header["sentence"]
    assert sentence.endswith(".") and "\n" not in sentence
    least = min(x["least"] for x in found.header["nearest"])
    assert found.header["kinds"] == ["own"]
    assert found.arrays["own"].min() >= least - 1e-3
