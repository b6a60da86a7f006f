"""One browser and one server for all page tests; errors on a page fail its test."""

import dataclasses
import functools
import os
import shutil
from collections.abc import Callable
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec

import pytest
from tests.studio.robot_logs import log, robot
from tools.studio_page import PATIENCE, Studio, browsing, find_browser, serving, write_job

import armcontour as ac

__all__ = ["log", "robot"]

Open = Callable[..., Studio]


@pytest.fixture(scope="module")
def browser():
    if find_spec("playwright") is None:
        pytest.skip("The page is not tested: pip install 'armcontour[browser]' drives a browser.")
    if find_browser() is None:
        pytest.skip("The page is not tested: no Chromium was found; ARMCONTOUR_CHROMIUM names one.")
    from playwright.sync_api import expect

    expect.set_options(timeout=PATIENCE)
    with browsing() as chromium:
        yield chromium


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of the module's job, which is the server's current one."""
    return tmp_path_factory.mktemp("studio")


@pytest.fixture(scope="module")
def drawings(folder):
    """Files that the module's job names; a module with such files writes them."""


@pytest.fixture(scope="module")
def job(folder, drawings, request):
    """The module's `JOB`, or else the paper's job with three runs and set-points every 4 ms."""
    file = folder / "job.yaml"
    text = getattr(request.module, "JOB", None)
    if text is None:
        return write_job(file, "conventional", "proposed", "optimal")
    file.write_text(text)
    return file


@pytest.fixture(autouse=True)
def state():
    """What earlier tests have not saved is offered to none."""
    yield
    shutil.rmtree(os.environ["XDG_STATE_HOME"], ignore_errors=True)


@pytest.fixture(scope="module")
def server(job):
    with serving(job, folder=job.parent) as address:
        yield address


@contextmanager
def opening(browser, server):
    """Opens pages; none may say anything in the console, or ask anyone else for anything."""
    with ExitStack() as closing:
        opened = []

        def open_page(address=server, **how):
            studio = Studio(browser, address, **how)
            closing.callback(studio.close)
            opened.append(studio)
            return studio

        yield open_page
        troubles = [x for studio in opened for x in studio.troubles]
        assert not troubles, troubles


@pytest.fixture
def pages(browser, server):
    """Opens pages of a test."""
    with opening(browser, server) as open_page:
        yield open_page


@pytest.fixture(scope="module")
def page(browser, server):
    """The page of all tests of a module that need no page of their own."""
    with opening(browser, server) as open_page:
        opened = open_page()
        opened.begin()
        yield opened


@pytest.fixture
def studio(page, job):
    """A page that shows the job as its file has it, and the run `optimal`."""
    page.tab("charts")
    page.open(job)
    page.choose_run("optimal")
    page.wait("#view2d", run="optimal")
    page.rest()
    return page


@functools.lru_cache(maxsize=32)
def _run(text, run, folder):
    file = folder / "judged.yaml"
    file.write_text(text)
    job = ac.read_job(file)
    chosen = tuple(x for x in job.runs if x.name == run)
    return ac.run(dataclasses.replace(job, runs=chosen)).runs[run]


@pytest.fixture
def judge(tmp_path):
    """What the library makes of the text that a page has."""
    return lambda studio, run="optimal", folder=tmp_path: _run(studio.text, run, folder)
