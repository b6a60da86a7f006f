"""Browser, server and pages, as in tests/browser."""

from tests.browser.conftest import browser, job, judge, page, pages, server, state, studio

__all__ = ["browser", "job", "judge", "page", "pages", "server", "state", "studio"]
