"""Plans and executions while a person edits."""

import copy

import numpy as np
import pytest
import yaml

from armcontour.errors import InvalidInput, Unreachable
from armcontour.io import parse_job
from armcontour.jobs import run
from armcontour.studio import preview
from armcontour.studio.preview import CONFIGURATION, Previewer
from armcontour.studio.preview_run import MOVING_SAMPLES


def whole(data, name, period):
    """The result of a full run with another command interval."""
    data = copy.deepcopy(data)
    data["runs"] = {name: data["runs"][name]}
    data["runs"][name]["command_interval"] = period
    data.pop("experiment", None)
    return run(parse_job(yaml.safe_dump(data))).runs[name]


class TestResults:
    @pytest.mark.parametrize("name", ["optimal", "proposed"])
    def test_they_are_those_of_a_run_with_the_same_interval(self, previewer, paper, name):
        planned = previewer.plan(paper, name)
        executed = previewer.execute(planned)
        found = whole(paper, name, 4e-3)
        assert planned.trajectory.duration == pytest.approx(found.trajectory.duration, abs=1e-12)
        assert executed.settled == found.evaluation.settled
        assert executed.errors.rms == pytest.approx(found.evaluation.contour_error.rms, rel=1e-12)
        assert executed.errors.max == pytest.approx(found.evaluation.contour_error.max, rel=1e-12)
        bindings = None if found.explanation is None else found.explanation.bindings
        assert bindings == (planned.explanation and planned.explanation.bindings)

    def test_bodies_judge_set_points_that_are_for_them(self, previewer, paper):
        job = previewer.job(paper, "inverse-dynamics")
        judged = run(job).runs["inverse-dynamics"].judged.contour_error
        for moving in (False, True):
            planned = previewer.plan(paper, "inverse-dynamics", moving=moving)
            executed = previewer.execute(planned, moving=moving)
            assert executed.errors.max < 3 * judged.max < 1e-5


class TestWhatIsDoneAgain:
    def test_only_what_depends_on_a_change_is_done_again(self, previewer, paper):
        first = previewer.execute(previewer.plan(paper, "optimal"))
        paper = paper | {"servo": {"kp": 20, "kv": 150}}
        planned = previewer.plan(paper, "optimal")
        assert set(planned.seconds) == {"keys", "job"}
        assert planned.trajectory is first.planned.trajectory
        executed = previewer.execute(planned)
        assert set(executed.seconds) == {"compensation", "execution", "evaluation"}
        assert executed.errors.rms != first.errors.rms
        first = previewer.plan(paper, "optimal")
        paper = paper | {"limits": paper["limits"] | {"speed": "0.1 m/s"}}
        second = previewer.plan(paper, "optimal")
        assert set(second.seconds) == {"keys", "job", "timing", "explanation"}
        assert second.traced is first.traced
        assert second.trajectory.duration > first.trajectory.duration
        previewer.plan(paper, "optimal")
        path = {"points": [*paper["path"]["points"][:-1], [0.351, 0.35]]}
        assert "arm" not in previewer.plan(paper | {"path": path}, "optimal").seconds

    def test_a_drawing_that_is_moved_is_not_read_again(self, previewer, paper):
        def moved(x):
            frame = {"position": [f"{x} mm", "200 mm", "0 mm"]}
            return previewer.drawn(paper | {"path": {"file": "gasket.dxf", "frame": frame}})

        first = moved(350)
        assert previewer._kept.seconds.keys() >= {"drawing", "path"}
        previewer._kept.seconds.clear()
        second = moved(360)
        assert "drawing" not in previewer._kept.seconds
        shift = second.contours[0].path(0.0) - first.contours[0].path(0.0)
        np.testing.assert_allclose(shift[:2], [0.01, 0.0], atol=1e-12)

    def test_what_was_looked_at_before_is_there_until_files_have_changed(self, previewer, paper):
        for name in ("optimal", "proposed"):
            previewer.execute(previewer.plan(paper, name))
        planned = previewer.plan(paper, "optimal")
        assert not planned.seconds and not previewer.execute(planned).seconds
        previewer.forget()
        assert "arm" in previewer.plan(paper, "optimal").seconds


class TestDifferences:
    def test_the_arm_stays_in_its_configuration(self, previewer, square):
        first = previewer.plan(square)
        assert CONFIGURATION not in first.differs
        square = square | {"limits": {"speed": 0.1}}
        second = previewer.plan(square)
        assert CONFIGURATION in second.differs
        np.testing.assert_allclose(second.start, first.start, atol=1e-9)
        # A full run may take another one; previews stay there from then on.
        other = first.start + [0, 0, 0, 0, 0, np.pi / 2]
        previewer.keep_start(previewer.job(square), other)
        third = previewer.plan(square)
        assert abs(third.start - first.start).max() > 1

    def test_a_configuration_that_does_not_reach_is_left(self, previewer, square, monkeypatch):
        first = previewer.plan(square)
        trace_run = preview.trace_run

        def refuse_start(job, *given):
            if job.start is not None:
                raise Unreachable("Not in this configuration.")
            return trace_run(job, *given)

        monkeypatch.setattr(preview, "trace_run", refuse_start)
        path = square["path"] | {"frame": {"position": [0.01, 0, 0]}}
        second = previewer.plan(square | {"path": path})
        assert CONFIGURATION not in second.differs
        assert second.trajectory.duration != first.trajectory.duration


def test_a_motion_of_minutes_is_planned_but_not_simulated(previewer, paper):
    paper["limits"]["speed"] = "1e-4 m/s"
    planned = previewer.plan(paper, "optimal")
    assert planned.trajectory.duration > 3000
    with pytest.raises(InvalidInput) as found:
        previewer.execute(planned)
    assert found.value.needed == planned.trajectory.duration > found.value.allowed


def test_set_points_are_made_as_for_the_experiment(previewer, paper):
    for experiment in (None, {}, {"gravity_feedforward": False}, {"runs": []}):
        data, name = paper | {"experiment": experiment}, "inverse-dynamics"
        (own,) = (x for x in parse_job(yaml.safe_dump(data)).runs if x.name == name)
        (found,) = previewer.job(data, name).runs
        assert found.compensation_options == own.compensation_options, experiment


def test_set_points_are_farther_apart_unless_gains_need_short_intervals(previewer, paper):
    with pytest.raises(InvalidInput):
        previewer.plan(paper, "other")
    planned = previewer.plan(paper, "optimal")
    assert planned.run.period == 4e-3
    assert planned.differs == ("set-points come every 4 ms, and in a run every 0.2 ms.",)
    assert previewer.plan(paper, "optimal", exact=True).run.period == 0.2e-3
    stiff = paper | {"servo": {"kp": 25, "kv": 300_000}}
    assert previewer.plan(stiff, "optimal").run.period == 0.2e-3


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
