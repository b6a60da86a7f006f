"""Fig. 6: how a straight line is generated, as a diagram."""

from __future__ import annotations

import matplotlib.pyplot as plt
from docs.figures import style
from docs.figures.diagram import arrow, box
from matplotlib.figure import Figure


def draw() -> Figure:
    """The two passes, their switching points, and the path between."""
    figure, axes = plt.subplots(figsize=(8.6, 4.9))
    axes.set(xlim=(0, 100), ylim=(0, 57))
    axes.axis("off")
    box(axes, (50, 53), (52, 7), "Line $P_s P_e$: knots, inverse kinematics (3), (4)")
    box(
        axes,
        (20, 39),
        (36, 10),
        "Forward pass from $P_s$\nMAC lap by lap, (18)-(21)",
        style.RULES["MAC"],
    )
    box(
        axes,
        (80, 39),
        (36, 10),
        "Reverse pass from $P_e$\nMAC backwards = MDC",
        style.RULES["MDC"],
    )
    box(axes, (20, 25), (36, 8), "Speed (22), (23) reaches $v_a$:  $P_1$", style.RULES["MAC"])
    box(axes, (80, 25), (36, 8), "Speed (22), (23) reaches $v_a$:  $P_2$", style.RULES["MDC"])
    box(
        axes,
        (50, 14),
        (38, 9),
        "Middle path $P_1 P_2$ at $v_a$\nAVC, (24), (25)",
        style.RULES["AVC"],
    )
    box(
        axes,
        (50, 31),
        (19, 13),
        "Passes meet\nbelow $v_a$: there\n$P_1 = P_2$, and no\nmiddle path",
        style.GREY,
        dashed=True,
    )
    box(axes, (50, 3), (76, 5.5), "Line = forward $P_s P_1$ + middle $P_1 P_2$ + reverse $P_2 P_e$")
    for begin, end in (
        ((35, 49.5), (20, 44)),
        ((65, 49.5), (80, 44)),
        ((20, 34), (20, 29)),
        ((80, 34), (80, 29)),
        ((20, 21), (31, 14)),
        ((80, 21), (69, 14)),
        ((50, 9.5), (50, 5.8)),
        ((16, 21), (16, 5.8)),
        ((84, 21), (84, 5.8)),
    ):
        arrow(axes, begin, end)
    for begin, end in (((38, 36), (40.5, 34.5)), ((62, 36), (59.5, 34.5))):
        arrow(axes, begin, end, dashed=True)
    axes.set_title("Generation of a realizable straight line (dashed: not in the paper)")
    return figure
