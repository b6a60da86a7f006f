"""Sweeps and places."""

import numpy as np
import pytest
import yaml
from tests.studio.tasks.asking import ask

from armcontour.errors import InvalidInput
from armcontour.io import parse_job
from armcontour.jobs import teach


def test_a_sweep_is_the_duration_over_a_key(coarse, drawings):
    speeds = [0.05, 0.1, 0.15]
    found = ask("sweep", coarse, "optimal", drawings, key="limits.speed", values=speeds)
    for speed, duration in zip(speeds, found.arrays["duration"], strict=True):
        data = coarse | {"limits": coarse["limits"] | {"speed": speed}}
        job = parse_job(yaml.safe_dump(data))
        planned = teach(job)["optimal"].trajectory
        assert duration == pytest.approx(planned.duration, abs=1e-9)
    assert (found.arrays["rms"] > 0).all() and found.header["refusals"] == [None] * 3


def test_values_of_a_sweep_that_are_refused_are_not_numbers(coarse, drawings):
    options = {"key": "corners.tolerance", "min": -1e-3, "max": 1e-3, "count": 2}
    found = ask("sweep", coarse, "optimal", drawings, **options)
    assert np.isnan(found.arrays["duration"]).tolist() == [True, False]
    assert "tolerance" in found.header["refusals"][0]


def test_a_place_that_is_better_is_found_in_the_plane(coarse, drawings):
    over = {"x": [-0.02, 0.02, 3], "y": [-0.02, 0.02, 3]}
    found = ask("place", coarse, "optimal", drawings, over=over, refined=False)
    # The part is moved by these, and they are written into the file.
    assert set(found.arrays["by"].ravel()) == {-0.02, 0.0, 0.02}
    assert found.arrays["by"].shape == (9, 2)
    durations = found.arrays["duration"]
    best = int(np.nanargmin(durations))
    by = found.header["best"]["by"]
    np.testing.assert_allclose(by, found.arrays["by"][best])
    # It stays true when the part is moved.
    assert found.header["sentence"].endswith("s less than where the part was.")
    frame = {"position": [float(by[0]), float(by[1]), 0.0]}
    moved = coarse | {"path": coarse["path"] | {"frame": frame}}
    taught = teach(parse_job(yaml.safe_dump(moved)))["optimal"]
    assert taught.trajectory.duration == pytest.approx(durations[best], rel=1e-4)


ASKED = {"over": {"x": {"from": -0.02, "to": 0.02, "places": 2}}, "refine": False, "run": "optimal"}


def test_the_question_is_that_of_the_job_and_options_replace_its_keys(coarse, drawings):
    data = coarse | {"placement": ASKED}
    found = ask("place", data, "optimal", drawings)
    assert found.arrays["by"].tolist() == pytest.approx(np.array([[-0.02, 0], [0.02, 0]]))
    more = ask("place", data, "optimal", drawings, over={"y": [0.01, 0.01, 1]})
    np.testing.assert_allclose(more.arrays["by"], [[-0.02, 0.01], [0.02, 0.01]], atol=1e-7)
    over = {"y": [0.0, 0.01, 2]}
    alone = ask("place", data, "optimal", drawings, over=over, as_job=False, refined=False)
    np.testing.assert_allclose(alone.arrays["by"], [[0, 0], [0, 0.01]], atol=1e-7)


def test_shifts_are_from_where_the_part_is_if_places_are_coordinates(coarse, drawings):
    span = {"from": 0.0, "to": 0.0, "places": 1}
    data = coarse | {"placement": ASKED | {"over": {"x": span}}}
    here = ask("place", data, "optimal", drawings)
    anchor = float(here.header["anchor"][0])
    span = {"from": anchor + 0.01, "to": anchor + 0.02, "places": 2}
    data = coarse | {"placement": ASKED | {"over": {"x": span}, "absolute": True}}
    found = ask("place", data, "optimal", drawings)
    np.testing.assert_allclose(found.arrays["by"], [[0.01, 0], [0.02, 0]], atol=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"what": "base"}, "cannot place the base"), ({"over": {"z": [0, 0.1, 2]}}, "along z")],
)
def test_what_a_click_on_the_map_cannot_do_is_refused(coarse, drawings, options, words):
    data = coarse | {"placement": ASKED}
    with pytest.raises(InvalidInput, match=words):
        ask("place", data, "optimal", drawings, **options)
