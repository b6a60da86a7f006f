"""Browser, server and pages, as in tests/browser."""

from tests.browser.conftest import (
    browser,
    drawings,
    folder,
    job,
    judge,
    page,
    pages,
    server,
    state,
    studio,
)

__all__ = [
    "browser",
    "drawings",
    "folder",
    "job",
    "judge",
    "page",
    "pages",
    "server",
    "state",
    "studio",
]
