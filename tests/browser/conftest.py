"""One browser and one server for all tests of the page; what no page may do fails its test."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import pytest
from soak.studio_page import PATIENCE, Server, Studio, browsing, find_browser, serving, write_job

import armcontour as ac
from armcontour.jobs.study import RunResult

if TYPE_CHECKING:
    from playwright.sync_api import Browser

Open: TypeAlias = Callable[..., Studio]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if find_spec("playwright") is None:
        pytest.skip("The page is not tested: pip install 'armcontour[browser]' drives a browser.")
    if find_browser() is None:
        pytest.skip("The page is not tested: no Chromium was found; ARMCONTOUR_CHROMIUM names one.")
    from playwright.sync_api import expect

    expect.set_options(timeout=PATIENCE)
    with browsing() as found:
        yield found


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's job with three of its runs, set-points every 4 ms."""
    folder = tmp_path_factory.mktemp("studio")
    return write_job(folder / "job.yaml", "conventional", "proposed", "optimal")


@pytest.fixture(scope="module")
def server(job: Path) -> Iterator[Server]:
    with serving(job, folder=job.parent) as found:
        yield found


@pytest.fixture
def pages(browser: Browser, server: Server) -> Iterator[Open]:
    """Opens pages; none may say anything in the console, or ask anyone else for anything."""
    with ExitStack() as closing:
        opened: list[Studio] = []

        def open_page(at: Server = server, **how: object) -> Studio:
            studio = Studio(browser, at, **how)  # type: ignore[arg-type]
            closing.callback(studio.close)
            opened.append(studio)
            return studio

        yield open_page
        troubles = [x for studio in opened for x in studio.troubles]
        assert not troubles, troubles


@pytest.fixture
def studio(pages: Open, job: Path) -> Studio:
    """A page that shows the job as its file has it, and the run `optimal`."""
    found = pages()
    found.begin()
    found.open(job)
    found.choose_run("optimal")
    found.wait("#view2d", run="optimal")
    found.rest()
    return found


@functools.lru_cache(maxsize=32)
def _run(text: str, run: str, folder: Path) -> RunResult:
    file = folder / "judged.yaml"
    file.write_text(text)
    job = ac.read_job(file)
    chosen = tuple(x for x in job.runs if x.name == run)
    return ac.run(dataclasses.replace(job, runs=chosen)).runs[run]


@pytest.fixture
def judge(tmp_path: Path) -> Callable[..., RunResult]:
    """What the library makes of the text that a page has."""
    return lambda studio, run="optimal", folder=tmp_path: _run(studio.text, run, folder)
