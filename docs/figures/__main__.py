"""Draw the figures of the documentation: `python -m docs.figures [NAME ...]`.

A figure is a function `draw_NAME` without arguments in `paper.py` or `concepts.py`.
"""

from __future__ import annotations

import sys

from docs.figures import concepts, paper, style

# Functions that draw figures, by the names of the figures.
FIGURES = {
    name.removeprefix("draw_"): draw
    for name, draw in (*vars(paper).items(), *vars(concepts).items())
    if name.startswith("draw_")
}


if __name__ == "__main__":
    for name in sys.argv[1:] or FIGURES:
        style.save(FIGURES[name](), style.FOLDER / f"{name}.svg")
