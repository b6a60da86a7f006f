"""One look for all figures: colours that colour-blind readers can tell apart, units, and saving."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

FOLDER = Path(__file__).parent

# Okabe and Ito's palette.
BLACK = "#000000"
GREY = "#7a7a7a"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"

OBJECTIVE = GREY
CONVENTIONAL = VERMILLION
PROPOSED = BLUE
OTHER = GREEN
JOINTS = (BLUE, VERMILLION)
RULES = {"MAC": BLUE, "AVC": GREEN, "MDC": VERMILLION, "corner": ORANGE}
RULE_NAMES = {
    "MAC": "MAC, largest acceleration",
    "AVC": "AVC, assigned velocity",
    "MDC": "MDC, largest deceleration",
    "corner": "corner, one speed",
}

LARGEST_SVG = 200_000  # bytes; a larger figure is saved as PNG
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


def save(figure: Figure, name: str, *, dpi: int = 160) -> Path:
    """Write a figure as SVG, or as PNG if the SVG is large; the same bytes every time."""
    vector = FOLDER / f"{name}.svg"
    figure.savefig(vector, metadata={"Date": None, "Creator": None})
    # Trailing blanks would trouble a text file under version control; others are dead weight.
    text = "\n".join(line.strip() for line in vector.read_text("utf-8").splitlines()) + "\n"
    text = CURVE.sub(lambda d: NUMBER.sub(_shortened, d.group()), text)
    vector.write_text(text, "utf-8")
    if vector.stat().st_size <= LARGEST_SVG:
        return vector
    vector.unlink()
    return save_png(figure, name, dpi=dpi)


def _shortened(number: re.Match[str]) -> str:
    """A coordinate to a hundredth of a point."""
    return f"{float(number.group()):.2f}".rstrip("0").rstrip(".")


def save_png(figure: Figure, name: str, *, dpi: int = 160) -> Path:
    """Write a figure as PNG; the same bytes every time."""
    image = FOLDER / f"{name}.png"
    figure.savefig(image, dpi=dpi, metadata={"Software": None})
    return image


def label(axes: Axes, text: str, at: tuple[float, float], offset: tuple[float, float]) -> None:
    """Write beside a point, on a white ground."""
    axes.annotate(
        text,
        at,
        xytext=offset,
        textcoords="offset points",
        ha="center",
        va="center",
        zorder=6,
        bbox={"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.8},
    )


def no_frame(axes: Axes) -> None:
    """Leave only the drawing, in equal scale."""
    axes.set_aspect("equal")
    axes.axis("off")
