"""All pages that are written when the site is built, and what of the repository they show."""

from __future__ import annotations

from pathlib import Path

from docs.gallery import pages as gallery
from docs.reference import job_keys
from docs.site.commands import write_commands
from docs.site.names import write_names

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent
FOLDER = DOCS / "reference" / "pages"
# Texts of the repository that are pages of the site too.
PROJECT = {
    "README.md": "readme",
    "CHANGELOG.md": "changelog",
    "CONTRIBUTING.md": "contributing",
    "SECURITY.md": "security",
}
# Where the site shows in a form of its own what a file of the repository holds.
SHOWN = {
    "src/armcontour/__init__.py": FOLDER / "api" / "index.md",
    "src/armcontour/cli/commands.py": FOLDER / "commands" / "index.md",
    **{file: FOLDER / "project" / f"{name}.md" for file, name in PROJECT.items()},
}


def written() -> dict[str, str]:
    """The text of every page that is written, by its place in the folder of such pages."""
    texts = {
        f"project/{name}.md": (ROOT / file).read_text(encoding="utf-8")
        for file, name in PROJECT.items()
    }
    return {**dict(write_names()), **dict(write_commands()), **texts}


def write() -> None:
    """Write them; pages that have not changed are left alone, and others are removed."""
    pages = written()
    if FOLDER.exists():
        for file in [x for x in FOLDER.rglob("*") if x.is_file()]:
            if file.relative_to(FOLDER).as_posix() not in pages:
                file.unlink()
    files = {FOLDER / name: text for name, text in pages.items()}
    files |= job_keys.published() | gallery.published()
    for file, text in files.items():
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
