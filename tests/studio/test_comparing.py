"""Two variants side by side: differences by figure and limit, and curves on one axis."""

import numpy as np
import pytest
import yaml
from tests.studio.conftest import PAPER

from armcontour.core.errors import InvalidInput
from armcontour.core.render import cells, number
from armcontour.files import parse_job
from armcontour.jobs import run
from armcontour.jobs.differences import differences
from armcontour.studio.tasks.dispatch import do

NAMES = ("optimal", "conventional")


@pytest.fixture(scope="module")
def job():
    return PAPER | {"runs": {x: PAPER["runs"][x] for x in NAMES}, "experiment": None}


@pytest.fixture(scope="module")
def results(job):
    return run(parse_job(yaml.safe_dump(job))).runs


def compared(job, **options):
    request = {"text": yaml.safe_dump(job), "run": NAMES[0], "options": options}
    return do("compare", request, lambda step: None)


def test_differences_are_those_of_the_results(job, results):
    frame = compared(job, **{"with": NAMES[1]})
    one, other = (results[x] for x in NAMES)
    rows = {x[0]: x[1:] for x in frame.header["table"]}
    times = [x.trajectory.duration for x in (one, other)]
    assert rows["motion"] == (*(number(x, "s") for x in times), number(times[0] - times[1], "s"))
    assert times[0] < times[1] and "shorter" in frame.header["sentence"]
    errors = [x.evaluation.contour_error.max for x in (one, other)]
    assert rows["contour error, largest"][:2] == tuple(number(x, "m") for x in errors)
    # A limit that only one of them knows takes no time of the other.
    for x in one.explanation.shares:
        assert rows[f"time: {x.name}"] == (
            number(x.time, "s"),
            number(0.0, "s"),
            f"+{number(x.time, 's')}",
        )
    table = differences(one.to_data(), other.to_data(), NAMES)
    assert frame.header["table"] == cells(table)


def test_curves_are_those_of_the_results_on_one_axis(job, results):
    a = compared(job, **{"with": NAMES[1]}).arrays
    for k, name in enumerate(NAMES):
        result = results[name]
        inside = np.flatnonzero(a["s"] < result.path.length - 1e-6)
        s = a["s"][inside].astype(float)
        expected = result.trajectory.speed_at(s)
        # Where the speed rises from rest, 32 bits of a place are much of a speed.
        fast = expected > 0.01
        np.testing.assert_allclose(a[f"speed_{k}"][inside][fast], expected[fast], rtol=1e-2)
        error = result.evaluation.contour_error
        assert np.nanmax(a[f"error_{k}"]) <= error.max * (1 + 1e-6)
        assert np.nanmax(a[f"error_{k}"]) > 0.9 * error.max
    assert len({len(x) for x in a.values()}) == 1


def test_the_job_before_an_edit_is_the_other_variant(job):
    wide = job | {"corners": {"tolerance": "8 mm"}}
    frame = compared(wide, text=yaml.safe_dump(job))
    assert list(frame.header["names"]) == ["now", "before"]
    deviation = next(x for x in frame.header["table"] if x[0] == "off the drawing")
    assert deviation[3].startswith("+")
    with pytest.raises(InvalidInput, match="has not been edited yet"):
        compared(wide)
