"""Links between pages of the site, and to files of the repository that are not pages."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from docs.site.written import DOCS, FOLDER, ROOT, SHOWN

# A link or picture in Markdown.
LINK = re.compile(r"(?P<mark>!?)\[(?P<text>[^\]]*)\]\((?P<target>[^)#\s:]+)(?P<anchor>#[^)\s]*)?\)")
# Endings of files that the site contains.
OWN = (".md", ".json", ".svg", ".png", ".webp", ".gif")


def mend(app: Any, name: str, source: list[str]) -> None:
    """Replace the links of a page by links to pages of the site, or to files in the repository.

    If the address of the repository is unknown, a link to one of its files becomes plain text.

    Args:
        app: Sphinx.
        name: Name of the page.
        source: Text of the page as the only item; it is replaced.
    """
    page = DOCS / f"{name}.md"
    # Links in copied texts of the repository, such as the README, are relative to its root.
    folder = ROOT if page.parent == FOLDER / "project" else page.parent

    def relative_link(match: re.Match[str]) -> str:
        target = (folder / match["target"]).resolve()
        if not target.is_relative_to(ROOT) or not target.exists():
            return match[0]
        place = target.relative_to(ROOT).as_posix()
        anchor = match["anchor"] or ""
        if place in SHOWN:
            target = SHOWN[place]
        elif not (target.is_relative_to(DOCS) and target.suffix in OWN):
            if not app.config.repository:
                return match["text"]
            kind = "tree" if target.is_dir() else "blob"
            return f"[{match['text']}]({app.config.repository}/{kind}/main/{place}{anchor})"
        to = Path(os.path.relpath(target, page.parent)).as_posix()
        return f"{match['mark']}[{match['text']}]({to}{anchor})"

    source[0] = LINK.sub(relative_link, source[0])
