"""Make the gallery: `python -m docs.gallery [NAME ...]` runs examples, and writes their pages."""

from __future__ import annotations

import io
import runpy
import sys
from contextlib import redirect_stdout

import matplotlib.pyplot as plt
from docs.figures import style
from docs.gallery import pages, pictures


def main(names: list[str]) -> int:
    """Make the pages of the named examples, or of all, and the list; returns an exit code."""
    unknown = sorted(set(names) - set(pages.SHOWN))
    if unknown:
        print(f"There is no example {unknown[0]}: they are {', '.join(pages.SHOWN)}.")
        return 2
    for name in names or pages.SHOWN:
        printed = io.StringIO()
        with redirect_stdout(printed):
            found = runpy.run_path(str(pages.EXAMPLES / f"{name}.py"), run_name="__main__")
        figure = getattr(pictures, f"draw_{name[:2]}")(found)
        # A path from the folder of the figures.
        print(style.save(figure, f"../{pages.FOLDER.name}/{name}").name)
        plt.close(figure)
        text = pages.page_of(name, printed.getvalue())
        (pages.FOLDER / f"{name}.md").write_text(text, encoding="utf-8")
    (pages.FOLDER / "index.md").write_text(pages.index(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
