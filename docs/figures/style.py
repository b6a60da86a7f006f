"""Style of all figures: colours that colour-blind readers can distinguish, boxes, saving."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

FOLDER = Path(__file__).parent

# Okabe and Ito's palette.
BLACK = "#000000"
GREY = "#7a7a7a"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILLION = "#D55E00"

OBJECTIVE = GREY
CONVENTIONAL = VERMILLION
PROPOSED = BLUE
OTHER = GREEN
RULES = {"MAC": BLUE, "AVC": GREEN, "MDC": VERMILLION, "corner": ORANGE}
RULE_NAMES = {
    "MAC": "MAC, largest acceleration",
    "AVC": "AVC, assigned velocity",
    "MDC": "MDC, largest deceleration",
    "corner": "corner, one speed",
}
LIMIT = {"color": BLACK, "lw": 0.8, "ls": "--"}  # a line that shows a limit

CURVE = re.compile(r' d="[^"]*"')
NUMBER = re.compile(r"-?\d+\.\d{3,}")

plt.rcParams.update(
    {
        "figure.constrained_layout.use": True,
        "figure.facecolor": "white",
        "savefig.facecolor": "white",
        "font.family": "DejaVu Sans",
        "font.size": 9,
        "axes.titlesize": 10,
        "axes.titleweight": "bold",
        "axes.labelsize": 9,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": "#e6e6e6",
        "grid.linewidth": 0.6,
        "axes.axisbelow": True,
        "legend.frameon": False,
        "legend.fontsize": 8,
        "lines.linewidth": 1.5,
        "lines.solid_joinstyle": "round",
        "path.simplify_threshold": 0.5,
        "svg.hashsalt": "armcontour",
        "svg.fonttype": "path",
    }
)


def save(figure: Figure, file: Path) -> None:
    """Write a figure as SVG with coordinates to a hundredth of a point, and close it."""
    figure.savefig(file, metadata={"Date": None, "Creator": None})
    text = CURVE.sub(lambda d: NUMBER.sub(_shortened, d.group()), file.read_text("utf-8"))
    file.write_text(text, "utf-8")
    plt.close(figure)
    print(file.name)


def _shortened(number: re.Match[str]) -> str:
    return f"{float(number.group()):.2f}".rstrip("0").rstrip(".")


def label(axes: Axes, text: str, point: tuple[float, float], offset: tuple[float, float]) -> None:
    """Write a text beside a point, on a white background."""
    axes.annotate(
        text,
        point,
        xytext=offset,
        textcoords="offset points",
        ha="center",
        va="center",
        zorder=6,
        bbox={"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.8},
    )


def box(
    axes: Axes, centre: tuple[float, float], size: tuple[float, float], text: str, colour: str
) -> None:
    """Draw a box with text."""
    corner = (centre[0] - size[0] / 2, centre[1] - size[1] / 2)
    form = "round,pad=0,rounding_size=0.8"
    axes.add_patch(
        FancyBboxPatch(corner, *size, boxstyle=form, fc="white", ec=colour, lw=1.6, zorder=3)
    )
    axes.text(*centre, text, ha="center", va="center", zorder=4)


def arrow(axes: Axes, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """Draw an arrow from one point to another."""
    look = {"arrowstyle": "-|>", "color": BLACK, "lw": 1, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, begin, arrowprops=look, zorder=2)
