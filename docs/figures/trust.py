"""What becomes of a file of somebody else: where it is read, and how results are placed."""

from __future__ import annotations

import matplotlib.pyplot as plt
from docs.figures import style
from docs.figures.diagram import arrow, box
from matplotlib.figure import Figure

FILE = "fig_trust"


def draw() -> Figure:
    """Files from the left, through their readers, to results on the right."""
    figure, axes = plt.subplots(figsize=(9.6, 4.4))
    axes.set(xlim=(0, 120), ylim=(0, 55), aspect="equal")
    axes.axis("off")
    for x, text in ((14, "not trusted"), (46, "checked"), (77, "computed"), (107, "placed")):
        axes.text(x, 52, text, ha="center", va="center", color=style.GREY, weight="bold")
    box(axes, (14, 41), (26, 12), "job, drawing,\nlog, URDF, mesh", style.VERMILLION)
    box(axes, (14, 24), (26, 9), "xacro file", style.VERMILLION)
    box(axes, (14, 8), (26, 9), "template", style.VERMILLION)
    box(
        axes,
        (46, 41),
        (27, 12),
        "reader: regular file,\nbounded size,\nstrict numbers",
        style.BLUE,
    )
    box(axes, (46, 24), (27, 9), "program, if\n--trust-xacro", style.ORANGE, dashed=True)
    box(axes, (46, 8), (27, 9), "sandbox, if named\nby --template", style.ORANGE, dashed=True)
    box(axes, (77, 41), (22, 12), "plan, proofs,\nexecution, report", style.BLACK)
    box(axes, (107, 41), (24, 12), "hidden folder,\nlocked", style.GREEN)
    box(axes, (107, 8), (24, 9), "results, with\nchecksums", style.GREEN)
    for begin, end in (
        ((27, 41), (32.5, 41)),
        ((27, 24), (32.5, 24)),
        ((27, 8), (32.5, 8)),
        ((59.5, 41), (66, 41)),
        ((88, 41), (95, 41)),
        ((107, 35), (107, 12.5)),
        ((59.5, 8), (95, 8)),
    ):
        arrow(axes, begin, end)
    axes.plot([59.5, 63, 63], [24, 24, 41], color=style.BLACK, lw=1)
    axes.text(108, 24, "one rename", ha="left", va="center", fontsize=8)
    axes.text(77, 9.5, "robot program", ha="center", va="bottom", fontsize=8)
    axes.plot([39, 46, 46, 46], [35, 35, 35, 35], lw=0)
    axes.text(
        46,
        31.5,
        "else refused: one sentence, with place",
        ha="center",
        fontsize=8,
        color=style.GREY,
    )
    return figure
