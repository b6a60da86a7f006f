"""Fig. 11: contour error over time, conventional method and proposed method."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Table I, mm: root mean square errors of the paper's simulations.
PRINTED = {"conventional": 2.630, "proposed": 0.164}
LOWEST = 1e-5  # mm


def curves(axes: Axes, *, uncompensated: bool = True) -> None:
    """The error profiles [mm] on a logarithmic scale."""
    runs = [
        (job.conventional(), style.CONVENTIONAL, "conventional"),
        (job.proposed("none"), style.OTHER, "proposed, no compensation"),
        (job.proposed(), style.PROPOSED, "proposed"),
    ]
    for result, colour, name in runs:
        if name == "proposed, no compensation" and not uncompensated:
            continue
        error = result.evaluation.contour_error
        t, values = _envelope(error.t, 1e3 * error.values)
        axes.plot(
            t, values, color=colour, lw=1.2, label=f"{name}: RMS {_three(1e3 * error.rms)} mm"
        )
    axes.set_yscale("log")
    axes.set(xlabel="time [s]", ylabel="contour error [mm]", ylim=(LOWEST, 40), xlim=(0, 12.06))


def _three(value: float) -> str:
    """A number in figures that tell it: 3.58, 0.027, 0.0023."""
    return f"{value:.2f}" if value >= 1 else f"{value:.2g}"


def _envelope(t: np.ndarray, values: np.ndarray, width: float = 0.01) -> tuple:
    """The largest value of every 10 ms: the zeros in between are of no interest on a log scale."""
    edges = np.arange(t[0], t[-1], width)
    first = np.searchsorted(t, edges)
    return edges, np.maximum(np.maximum.reduceat(values, first), LOWEST)


def draw() -> Figure:
    """Linear above, as in the paper; logarithmic below."""
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(8.6, 6.4), sharex=True)
    for result, colour, name in (
        (job.conventional(), style.CONVENTIONAL, "conventional, from the objective path"),
        (job.proposed(), style.PROPOSED, "proposed, from the rounded path"),
    ):
        error = result.evaluation.contour_error
        top.plot(error.t, 1e3 * error.values, color=colour, label=name)
    top.set(ylabel="contour error [mm]", ylim=(0, 16), title="(a) Linear scale")
    top.legend(loc="upper left")
    curves(bottom)
    for name, colour in (("conventional", style.CONVENTIONAL), ("proposed", style.PROPOSED)):
        bottom.axhline(PRINTED[name], color=colour, lw=0.8, ls="--")
        bottom.text(
            5.45,
            PRINTED[name] * 1.15,
            f"printed RMS, {name}: {PRINTED[name]:.3f} mm",
            color=colour,
            fontsize=7.5,
            ha="center",
            va="bottom",
        )
    bottom.set_title("(b) Logarithmic scale, largest value of every 10 ms")
    bottom.legend(loc="lower right")
    return figure
