"""Pages that are generated when the site is built, and files of the repository that they show."""

from __future__ import annotations

from pathlib import Path

from docs.gallery import pages as gallery
from docs.reference import controller_facts, job_keys
from docs.site.commands import write_commands
from docs.site.names import write_names

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent
FOLDER = DOCS / "reference" / "pages"
# Files of the repository that are also pages of the site.
PROJECT = {
    "README.md": "readme",
    "CHANGELOG.md": "changelog",
    "CONTRIBUTING.md": "contributing",
    "SECURITY.md": "security",
}
# Maps files of the repository to the generated pages that show their content.
SHOWN = {
    "src/armcontour/__init__.py": FOLDER / "api" / "index.md",
    "src/armcontour/cli/commands.py": FOLDER / "commands" / "index.md",
    **{file: FOLDER / "project" / f"{name}.md" for file, name in PROJECT.items()},
}


def written() -> dict[str, str]:
    """Map the place of each generated page in `FOLDER` to its text."""
    texts = {
        f"project/{name}.md": (ROOT / file).read_text(encoding="utf-8")
        for file, name in PROJECT.items()
    }
    return {**dict(write_names()), **dict(write_commands()), **texts}


def write() -> None:
    """Write all generated pages that have changed, and remove pages that no longer exist."""
    pages = written()
    if FOLDER.exists():
        for file in [x for x in FOLDER.rglob("*") if x.is_file()]:
            if file.relative_to(FOLDER).as_posix() not in pages:
                file.unlink()
    files = {FOLDER / name: text for name, text in pages.items()}
    files |= job_keys.published() | controller_facts.published() | gallery.published()
    for file, text in files.items():
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
