"""Boxes and arrows."""

from __future__ import annotations

from docs.figures import style
from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch


def box(
    axes: Axes,
    centre: tuple[float, float],
    size: tuple[float, float],
    text: str,
    colour: str = style.BLACK,
    *,
    dashed: bool = False,
) -> None:
    """A box with text."""
    axes.add_patch(
        FancyBboxPatch(
            (centre[0] - size[0] / 2, centre[1] - size[1] / 2),
            *size,
            boxstyle="round,pad=0,rounding_size=0.8",
            fc="white",
            ec=colour,
            lw=1.6,
            ls="--" if dashed else "-",
            zorder=3,
        )
    )
    axes.text(*centre, text, ha="center", va="center", zorder=4)


def arrow(
    axes: Axes, begin: tuple[float, float], end: tuple[float, float], *, dashed: bool = False
) -> None:
    """An arrow from one place to another."""
    axes.annotate(
        "",
        end,
        begin,
        arrowprops={
            "arrowstyle": "-|>",
            "color": style.GREY if dashed else style.BLACK,
            "lw": 1,
            "ls": "--" if dashed else "-",
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=2,
    )
