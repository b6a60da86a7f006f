"""Make the gallery: `python -m docs.gallery [NAME ...]` runs examples, and writes their pages."""

from __future__ import annotations

import io
import runpy
import sys
from contextlib import redirect_stdout

from docs.figures import style
from docs.gallery import pages, pictures

if __name__ == "__main__":
    for name in sys.argv[1:] or pages.SHOWN:
        printed = io.StringIO()
        with redirect_stdout(printed):
            found = runpy.run_path(str(pages.EXAMPLES / f"{name}.py"), run_name="__main__")
        style.save(getattr(pictures, f"draw_{name[:2]}")(found), pages.FOLDER / f"{name}.svg")
        text = pages.page_of(name, printed.getvalue())
        (pages.FOLDER / f"{name}.md").write_text(text, encoding="utf-8")
    (pages.FOLDER / "index.md").write_text(pages.index(), encoding="utf-8")
