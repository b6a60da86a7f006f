"""The run of a preview."""

import numpy as np
import pytest
import yaml

from armcontour.errors import InvalidInput
from armcontour.io import parse_job
from armcontour.studio.preview import Previewer
from armcontour.studio.preview_run import ARCS, MOVING_SAMPLES


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


def test_while_something_moves_errors_are_those_at_fewer_samples(previewer, paper):
    planned = previewer.plan(paper, "optimal")
    every, fewer = previewer.execute(planned), previewer.execute(planned, moving=True)
    assert 3 * MOVING_SAMPLES < len(every.execution.t)
    assert MOVING_SAMPLES <= len(fewer.execution.t) < 2 * MOVING_SAMPLES
    own = np.searchsorted(every.errors.t, fewer.errors.t)
    # The profile ends where the tool is at rest, which is between samples.
    wanted = every.errors.values[own[:-1]]
    assert fewer.errors.values[:-1] == pytest.approx(wanted, abs=1e-12)
    assert fewer.errors.rms == pytest.approx(every.errors.rms, rel=1e-3)
    assert fewer.errors.max <= every.errors.max
    # What the drives need is not only known at the samples.
    assert (fewer.execution.demand_range == every.execution.demand_range).all()
    assert previewer.execute(planned).errors.max == every.errors.max


def test_short_contours_keep_all_their_samples(paper, tmp_path):
    lines = '<path d="M 350 100 L 400 140"/><path d="M 300 250 L 330 290"/>'
    size = 'width="500mm" height="500mm" viewBox="0 0 500 500"'
    drawing = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{lines}</svg>'
    (tmp_path / "two.svg").write_text(drawing)
    previewer = Previewer(tmp_path)
    paper["limits"]["speed"] = "20 mm/s"
    planned = previewer.plan({**paper, "path": {"file": "two.svg"}}, "optimal")
    every, fewer = previewer.execute(planned), previewer.execute(planned, moving=True)
    assert len(every.execution.t) > 2 * MOVING_SAMPLES
    assert len(fewer.execution.t) == len(every.execution.t)
