"""Fig. 7: where the compensator stands between trajectory and servo."""

from __future__ import annotations

import matplotlib.pyplot as plt
from docs.figures import style
from docs.figures.diagram import arrow, box
from matplotlib.figure import Figure
from matplotlib.patches import Circle


def draw() -> Figure:
    """Realizable trajectory, compensator, servo (7), joint."""
    figure, axes = plt.subplots(figsize=(9.6, 3.2))
    axes.set(xlim=(-6, 134), ylim=(0, 40), aspect="equal")
    axes.axis("off")
    y = 20
    arrow(axes, (-5, y), (10, y))
    axes.text(1.5, y + 2.5, "realizable\ntrajectory", ha="center", va="bottom", fontsize=8)
    box(axes, (19, y), (18, 11), "compensator\n$F_j(s)$, (26)", style.RULES["corner"])
    arrow(axes, (28, y), (47.8, y))
    axes.text(35.5, y + 2.5, "taught data\n$u_j$", ha="center", va="bottom", fontsize=8)
    for x in (50, 68):
        axes.add_patch(Circle((x, y), 2.2, fc="white", ec=style.BLACK, lw=1))
        axes.text(x - 3.6, y + 3, "+", ha="center", va="center", fontsize=8)
        axes.text(x + 2.2, y - 4.2, "−", ha="center", va="center", fontsize=9)
    arrow(axes, (52.2, y), (55, y))
    box(axes, (59, y), (8, 8), "$K_{pj}$", style.BLUE)
    arrow(axes, (63, y), (65.8, y))
    arrow(axes, (70.2, y), (73, y))
    box(axes, (77, y), (8, 8), "$K_{vj}$", style.BLUE)
    arrow(axes, (81, y), (84, y))
    box(axes, (90, y), (12, 8), "sat, (7)", style.VERMILLION)
    arrow(axes, (96, y), (102, y))
    axes.text(99, y + 2, r"$\ddotθ_j$", ha="center", va="bottom")
    box(axes, (105, y), (6, 8), "1/s", style.BLUE)
    arrow(axes, (108, y), (115, y))
    axes.text(111.5, y + 2, r"$\dotθ_j$", ha="center", va="bottom")
    box(axes, (118, y), (6, 8), "1/s", style.BLUE)
    arrow(axes, (121, y), (134, y))
    axes.text(131, y + 2, "$θ_j$", ha="center", va="bottom")
    for x, to, low in ((111.5, 68, 12), (125, 50, 8)):
        axes.plot([x, x, to, to], [y, low, low, y - 2.2], color=style.BLACK, lw=1)
        axes.plot([x], [y], "o", color=style.BLACK, ms=3)
        arrow(axes, (to, y - 5), (to, y - 2.2))
    axes.plot([44, 44, 127.5, 127.5, 44], [5, 32, 32, 5, 5], color=style.GREY, lw=0.8, ls="--")
    axes.text(85.7, 33, "servo of joint $j$", color=style.GREY, ha="center", va="bottom")
    axes.set_title("Forward compensation of the servo's delay", pad=10)
    return figure
