"""Draw all figures of the documentation: `python -m docs.figures [NAME ...]`."""

from __future__ import annotations

import importlib
import sys

import matplotlib.pyplot as plt
from docs.figures import style

NAMES = (
    "bends",
    "certificate",
    "clearance",
    "drawings",
    "evaluation",
    "execution",
    "fig03_corner",
    "fig04_line",
    "fig05_passes",
    "fig06_algorithm",
    "fig07_blocks",
    "fig08_trajectory",
    "fig09_profiles",
    "fig10_results",
    "fig11_errors",
    "identification",
    "jerk",
    "learning",
    "optimal",
    "overview",
    "poles",
    "robustness",
    "shaping",
    "tracing",
    "trust",
)


def main(names: list[str]) -> int:
    """Draw the named figures, or all; returns an exit code."""
    unknown = sorted(set(names) - set(NAMES))
    if unknown:
        print(f"There is no figure {unknown[0]}: the figures are {', '.join(NAMES)}.")
        return 2
    for name in names or NAMES:
        module = importlib.import_module(f"docs.figures.{name}")
        figure = module.draw()
        # A module may give its picture another name than its own.
        file = getattr(module, "FILE", name)
        print(style.save(figure, file).relative_to(style.FOLDER))
        plt.close(figure)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
