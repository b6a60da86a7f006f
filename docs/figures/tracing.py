"""A rounded path traced: knots in both spaces, and how far the quintics take the tool off it."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure

import armcontour as ac

FILE = "fig_tracing"

TOLERANCES = {1e-8: style.ORANGE, 1e-10: style.BLUE}  # m; the second one is the default
PLACES = 9  # of every interval
CURVE = 400
FLOOR = 1e-17  # m: what is below is rounding


def draw() -> Figure:
    """Path and joint path with the knots of a coarse tolerance; tool errors of both tolerances."""
    figure = plt.figure(figsize=(9.0, 6.2))
    places = figure.subplot_mosaic([["tool", "joints"], ["off", "off"]], height_ratios=(1.5, 1))
    tool, joints, off = places["tool"], places["joints"], places["off"]
    s = np.linspace(0, job.ROUNDED.length, CURVE)
    traced = {x: ac.trace(job.ROUNDED, job.ARM, tolerance=x) for x in TOLERANCES}
    coarse = next(iter(traced.values()))
    tool.plot(*1e3 * job.ROUNDED(s).T, color=style.GREY)
    tool.plot(*1e3 * job.ROUNDED(coarse.breaks).T, "o", color=style.ORANGE, ms=3.5)
    tool.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    tool.set_title("(a) Tool path: lines and arcs")
    joints.plot(*np.degrees(coarse(s)).T, color=style.GREY, label="quintics")
    joints.plot(
        *np.degrees(coarse(coarse.breaks)).T, "o", color=style.ORANGE, ms=3.5, label="knots, exact"
    )
    joints.set(xlabel="joint 1 [°]", ylabel="joint 2 [°]")
    joints.set_title("(b) Joint path, knots of the coarse tolerance")
    joints.legend()
    for (tolerance, colour), path in zip(TOLERANCES.items(), traced.values(), strict=True):
        places_of = np.linspace(path.breaks[:-1], path.breaks[1:], PLACES, axis=1).ravel()
        error = np.linalg.norm(job.ARM.forward(path(places_of)) - job.ROUNDED(places_of), axis=1)
        if len(error) > 1500:
            keep = np.linspace(0, len(error) - 1, 1500).astype(int)
            places_of, error = places_of[keep], error[keep]
        off.semilogy(1e3 * places_of, np.maximum(error, FLOOR), color=colour, lw=0.8)
        off.axhline(tolerance, color=colour, lw=0.9, ls="--")
        count = len(path.breaks)
        off.plot([], [], color=colour, label=f"tolerance {tolerance:.0e} m: {count} knots")
    off.set(xlabel="arc length s [mm]", ylabel="tool off its place [m]", ylim=(FLOOR, 1e-5))
    off.set_title("(c) Between the knots")
    off.legend(loc="upper right", ncols=2)
    return figure
