"""The browser, its server and its pages, as for the journeys of the suite."""

from tests.browser.conftest import browser, job, judge, page, pages, server, state, studio

__all__ = ["browser", "job", "judge", "page", "pages", "server", "state", "studio"]
