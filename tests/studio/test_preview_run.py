"""The run of a preview."""

import pytest
import yaml

from armcontour.errors import InvalidInput
from armcontour.io import parse_job
from armcontour.studio.preview_run import ARCS


@pytest.mark.parametrize("experiment", [None, {}, {"gravity_feedforward": False}, {"runs": []}])
def test_set_points_are_made_as_for_the_experiment(previewer, paper, experiment):
    paper["experiment"] = experiment
    name = "inverse-dynamics"
    (own,) = (x for x in parse_job(yaml.safe_dump(paper)).runs if x.name == name)
    (found,) = previewer.job(paper, name).runs
    assert found.compensation_options == own.compensation_options


def test_an_unknown_run_is_refused(previewer, paper):
    with pytest.raises(InvalidInput, match="has no run other: it has conventional, uncomp"):
        previewer.plan(paper, "other")


def test_set_points_are_farther_apart(previewer, paper):
    planned = previewer.plan(paper, "optimal")
    assert planned.run.period == 4e-3
    assert planned.differs == ("set-points come every 4 ms, and in a run every 0.2 ms.",)
    assert previewer.plan(paper, "optimal", exact=True).run.period == 0.2e-3


def test_gains_that_need_short_intervals_have_them(previewer, paper):
    paper["servo"] = {"kp": 25, "kv": 300_000}
    assert previewer.plan(paper, "optimal").run.period == 0.2e-3


def test_free_shapes_are_arcs(previewer, paper):
    planned = previewer.plan(paper, "shaped")
    assert ARCS in planned.differs
    assert planned.path.path.corners.error.max() == pytest.approx(5e-3)
