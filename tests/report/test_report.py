"""The report: its numbers are the evaluation's, it works offline, and text is escaped."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path as FilePath

import numpy as np
import pytest

from armcontour.cli.running import built_in_job
from armcontour.errors import InvalidInput
from armcontour.report import render_report, write_report
from armcontour.report.sections.motion import _saturated
from armcontour.report.style import thinned
from armcontour.study import Study, run


@pytest.fixture(scope="module")
def study() -> Study:
    """The paper's job, coarsely, to be quick."""
    job = built_in_job()
    coarse = tuple(dataclasses.replace(x, period=4e-3) for x in job.runs)
    return run(dataclasses.replace(job, runs=coarse, title="<b>T & J</b>"))


@pytest.fixture(scope="module")
def page(study: Study) -> str:
    return render_report(study)


def test_figures_of_the_evaluation_stand_in_the_page(study: Study, page: str) -> None:
    for result in study.runs.values():
        e = result.evaluation
        assert f"{e.duration:.3f} s" in page
        assert f"{e.contour_error.rms * 1e3:.4f} mm" in page
        assert f"{e.contour_error.max * 1e3:.4f} mm" in page


def test_published_figures_ratios_and_time_stamps_stand_beside_ours(page: str) -> None:
    for text in ("2.630 mm", "0.164 mm", "46.4%", "6.2%", "5.770", "P9", "line 2: AVC"):
        assert text in page


def test_all_sections_are_there_in_order(page: str) -> None:
    keys = (
        "overview published paths joint-space speed bindings accelerations contour-error "
        "time-stamps".split()
    )
    places = [page.index(f'<section id="{key}">') for key in keys]
    assert places == sorted(places)


def test_what_binds_is_said_with_its_place(page: str) -> None:
    assert "centripetal acceleration at s = 0.075 m: 0.0324 of 0.15 m/s" in page


def test_works_offline_and_escapes_text(page: str) -> None:
    assert "<b>T & J</b>" not in page
    assert "&lt;b&gt;T &amp; J&lt;/b&gt;" in page
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=", page)


def test_a_job_without_corners_or_published_figures_has_a_report(study: Study) -> None:
    only = dataclasses.replace(study.job, runs=study.job.runs[:1], published=None)
    page = render_report(run(only))
    assert '<section id="published">' not in page
    assert '<section id="bindings">' not in page
    assert "Corners enlarged" not in page


def test_writes_whole_or_not_at_all(study: Study, tmp_path: FilePath) -> None:
    write_report(study, tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8").endswith("</html>")
    with pytest.raises(InvalidInput, match="Cannot write the report"):
        write_report(study, tmp_path / "none" / "report.html")
    assert [x.name for x in tmp_path.iterdir()] == ["report.html"]


def test_thinning_keeps_every_peak() -> None:
    t = np.linspace(0, 1, 100_000)
    y = np.zeros_like(t)
    y[54_321] = 7.0
    y[12_345] = -3.0
    t2, y2 = thinned(t, y)
    assert len(t2) < 4000
    assert (y2.max(), y2.min()) == (7.0, -3.0)
    assert np.all(np.diff(t2) > 0)
    assert (t2[0], t2[-1]) == (0, 1)


def test_saturated_stretches_are_joined_where_they_are_neighbours() -> None:
    t = np.linspace(0, 10, 10_001)
    demand = np.zeros_like(t)
    demand[1000:2000] = 2.0
    demand[2005:2991] = -2.0
    demand[7000:] = 2.0
    demand[5000] = 1.0005
    assert _saturated(t, demand, 1.0) == [
        (pytest.approx(1.0), pytest.approx(2.99)),
        (pytest.approx(7.0), pytest.approx(10.0)),
    ]
