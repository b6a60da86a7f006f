"""Accessibility faults of a page in a browser, as reported by axe-core."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

FILE = FilePath(__file__).parent / "axe" / "axe.min.js"
GRAVE = ("serious", "critical")
ALL = ("minor", "moderate", *GRAVE)
RULES = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")


def load_axe(page: Page) -> None:
    """Load axe-core into a page."""
    page.evaluate(FILE.read_text(encoding="utf-8"))


def faults(
    page: Page,
    *,
    impacts: Sequence[str] = GRAVE,
    rules: Sequence[str] = RULES,
    without: Sequence[str] = (),
) -> list[str]:
    """Faults of a page as it is now, by default serious and critical ones; axe-core is loaded.

    Args:
        page: The page.
        impacts: Impacts of the faults that are returned.
        rules: Tags of the rules; without any, all rules.
        without: Selectors of what is not looked at.
    """
    options = {"resultTypes": ["violations"]} | ({"runOnly": list(rules)} if rules else {})
    report = page.evaluate(
        "([options, exclude]) => axe.run({include: document, exclude}, options)",
        [options, [[x] for x in without]],
    )
    found = []
    for violation in report["violations"]:
        if violation["impact"] in impacts:
            found += [f"{violation['id']}: {node['html'][:160]}" for node in violation["nodes"]]
    return found
