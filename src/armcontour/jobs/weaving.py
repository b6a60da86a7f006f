"""How wide and how often the planned tool path weaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Limits
from armcontour.geometry import Path
from armcontour.motion import Trajectory
from armcontour.motion.trajectory import Span
from armcontour.program import Contour, Program, contour_called

# Samples of the planned path per wave.
SAMPLES = 64
# Relative difference from what was asked above which there is a warning.
ALLOWED = 0.02
# A limit is reached from this share of it on.
REACHED = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Weaving:
    """What the plan makes of the weave of a contour, where the weave has its full width.

    Args:
        contour: What messages call the contour.
        width: Smallest and largest distance between neighbouring crests, across the seam [m].
        frequency: Smallest and largest number of waves per second [1/s].
        asked: Width [m] and frequency [1/s] that were asked for; the frequency is NaN without an
            assigned velocity.
        left_out: Length of the seam that is not woven, in parts shorter than half a pitch [m].
        slowed_by: The limit that the plan reaches, in words.
    """

    contour: str
    width: tuple[float, float]
    frequency: tuple[float, float]
    asked: tuple[float, float]
    left_out: float
    slowed_by: str

    @property
    def sentence(self) -> str:
        """The widths and the frequencies."""
        width = _range(self.width, 1e3)
        frequency = _range(self.frequency, 1.0)
        return f"{self.contour} weaves {width} mm wide at {frequency} Hz."

    @property
    def warnings(self) -> list[str]:
        """Sentences on what differs from what was asked for."""
        found = []
        if max(abs(x - self.asked[0]) for x in self.width) > ALLOWED * self.asked[0]:
            found.append(
                f"{self.contour} weaves {_range(self.width, 1e3)} mm wide in place of "
                f"{self.asked[0] * 1e3:.4g} mm, because the corners of the weave are rounded: "
                "give a smaller corner tolerance, or the shape sine."
            )
        if self.frequency[0] < (1 - ALLOWED) * self.asked[1]:
            found.append(
                f"{self.contour} weaves at {_range(self.frequency, 1.0)} Hz in place of "
                f"{self.asked[1]:.4g} Hz, because {self.slowed_by} slows the tool down: give a "
                "lower velocity or frequency, a smaller width, or a higher limit."
            )
        if self.left_out:
            found.append(
                f"{self.contour} is not woven along {self.left_out * 1e3:.4g} mm of its seam, in "
                "parts between corners that are shorter than half a pitch."
            )
        return found


def weavings(program: Program, trajectory: Trajectory, limits: Limits) -> list[Weaving]:
    """What the plan makes of each weave.

    Args:
        program: The program that was planned.
        trajectory: Its plan.
        limits: Its limits.
    """
    pairs = zip(program.contours, trajectory.contour_spans, strict=True)
    found = (_weaving(i, x, span, limits) for i, (x, span) in enumerate(pairs))
    return [x for x in found if x is not None]


def _weaving(number: int, contour: Contour, span: Span, limits: Limits) -> Weaving | None:
    """What the plan makes of the weave of a contour; None without waves of full width."""
    woven, plan = contour.woven, span.trajectory
    if woven is None or plan is None or len(woven.crests) < 3:
        return None
    begin, end = (0.0, plan.duration) if span.work is None else span.work
    offset = 0.0 if span.work is None else span.t[0]
    count = int(SAMPLES * woven.seam.length / woven.pitch) + 2
    t = np.linspace(begin - offset, end - offset, count).clip(0.0, plan.duration)
    near = woven.seam.project(contour.path(plan.s(t).clip(0.0, contour.path.length)))
    # The tool may stop or turn, but along the seam it only goes on.
    s = np.maximum.accumulate(near.s)
    at = np.interp(woven.crests, s, t)
    heights = _heights(s, near.distance, woven.crests, woven.pitch / 4)
    widths, times = heights[:-1] + heights[1:], at[2:] - at[:-2]
    # Crests of two parts of the seam belong to no common wave.
    same = np.diff(woven.crests) < 0.75 * woven.pitch
    widths, times = widths[same], times[same[:-1] & same[1:]]
    if not len(times):
        return None
    return Weaving(
        contour=contour_called(contour, number),
        width=(float(widths.min()), float(widths.max())),
        frequency=(float(1 / times.max()), float(1 / times.min())),
        asked=(woven.width, woven.frequency),
        left_out=woven.left_out,
        slowed_by=_slowed_by(contour.path, plan, limits),
    )


def _slowed_by(path: Path, plan: Trajectory, limits: Limits) -> str:
    """The limit that slows a weave: of the centripetal acceleration if it is reached."""
    limit = limits.centripetal_acceleration
    s = (path.breaks[:-1] + path.breaks[1:]) / 2
    reached = float((np.abs(path.curvatures) * plan.speed_at(s) ** 2).max())
    if limit is None or reached < REACHED * limit:
        return "a limit of the joints or of the tool"
    return f"limits.centripetal_acceleration of {limit:.4g} m/s²"


def _heights(s: FloatArray, off: FloatArray, crests: FloatArray, reach: float) -> FloatArray:
    """Largest distances from the seam near crests [m], (n,)."""
    first, last = np.searchsorted(s, crests - reach), np.searchsorted(s, crests + reach)
    return np.array([off[i:j].max(initial=0.0) for i, j in zip(first, last, strict=True)])


def _range(pair: tuple[float, float], scale: float) -> str:
    """Two numbers as text, or one if they are printed alike."""
    low, high = (f"{scale * x:.3g}" for x in pair)
    return low if low == high else f"{low} to {high}"
