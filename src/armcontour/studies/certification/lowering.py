"""What a certified plan leaves of speed and acceleration: how much, where, and for what."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.render import number
from armcontour.core.text import joint_label
from armcontour.motion import Trajectory
from armcontour.studies.certification._derating import CAUSES, Derating

# Less than this share of a limit is not lowered: searches aim that little below their limits. What
# is nowhere lowered by more than SAID is not worth a sentence.
LEAST, SAID = 1e-5, 1e-3
# A larger share of a contour is called all of it.
NEARLY_ALL = 0.995
# Why something is lowered, after "for".
REASONS = {
    "acceleration": "the acceleration limits of the joints",
    "speed": "the limits of tool and joint velocities in plan and command",
    "tool": "the speed of the executed tool, which passed the assigned velocity",
    "error": "the contour error",
    "box": "the contour error of robots of the box",
    "limit": "what drives and plan need of it",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class DeratedInterval:
    """A demand that a certified plan had to be lowered for.

    Args:
        what: What is lowered: "speed", "acceleration" of a joint, or the name of another limit.
        cause: For what, a key of `REASONS`.
        share: Largest share that it is lowered by: of the speed of the plan with nothing derated,
            or of the limit.
        joint: Index of the joint that is derated most, from 0; None for what is not of a joint.
        joint_name: Its number with its name; "" without a joint.
        s: Arc length at which it is lowered most [m]; None for limits lowered along all of it.
        t: Time in the whole motion at which the plan is there [s]; None without a place.
        length: Length of the contour along which it is lowered [m].
        contour: Length of the contour [m].
    """

    what: str
    cause: str
    share: float
    joint: int | None
    joint_name: str
    s: float | None
    t: float | None
    length: float
    contour: float

    def __str__(self) -> str:
        """What is lowered, by how much, where and for what, as a clause."""
        of = f" of joint {self.joint_name}" if self.joint_name else ""
        where = f"over {number(self.length, 'm')} of {number(self.contour, 'm')}"
        if self.length > NEARLY_ALL * self.contour:
            where = "along the whole contour"
        place = (
            ""
            if self.s is None
            else f", most at s = {number(self.s, 'm')}, t = {number(self.t, 's')}"
        )
        return (
            f"{self.what.replace('_', ' ')}{of} by up to {number(self.share, '1')} "
            f"{where}{place}, for {REASONS[self.cause]}"
        )


def find_lowered(
    derating: Derating,
    factors: Mapping[str, float],
    squares: FloatArray,
    plan: Trajectory,
    start: float,
    names: Sequence[str],
) -> tuple[DeratedInterval, ...]:
    """Find what a plan of a contour was lowered for, the largest share of each kind first.

    Args:
        derating: Its derating by place.
        factors: Shares that are left of other limits.
        squares: Largest ds² in the cells of the derating with nothing derated [m²/s²], (n,).
        plan: The plan; times from 0 [s].
        start: Start time of the contour in the whole motion [s].
        names: Names of the joints.
    """
    places = (derating.cells[:-1] + derating.cells[1:]) / 2
    contour = float(derating.cells[-1])

    def at(k: int, off: BoolArray) -> dict[str, float]:
        s = float(places[k])
        t = start + float(plan.time_at(np.array([s]))[0])
        return {"s": s, "t": t, "length": float(derating.width[off].sum()), "contour": contour}

    def found() -> Iterator[DeratedInterval]:
        with np.errstate(divide="ignore", invalid="ignore"):
            slower = np.maximum(1 - np.sqrt(derating.cap / squares), 0.0)
        for index, cause in enumerate(CAUSES):
            share = np.where(derating.cap_by == index, np.nan_to_num(slower), 0.0)
            k = int(np.argmax(share))
            if share[k] > SAID:
                yield DeratedInterval(
                    what="speed",
                    cause=cause,
                    share=float(share[k]),
                    joint=None,
                    joint_name="",
                    **at(k, share > LEAST),
                )
        for cause, left in derating.share_by.items():
            share = 1 - left
            k, j = (int(x) for x in np.unravel_index(np.argmax(share), share.shape))
            if share[k, j] > SAID:
                alike = bool((left == left[:, :1]).all())
                yield DeratedInterval(
                    what="acceleration",
                    cause=cause,
                    share=float(share[k, j]),
                    joint=None if alike else j,
                    joint_name="" if alike else joint_label(j + 1, names),
                    **at(k, np.asarray((share > LEAST).any(axis=1))),
                )
        for name, factor in factors.items():
            if 1 - factor > SAID:
                yield DeratedInterval(
                    what=name,
                    cause="limit",
                    share=1 - factor,
                    joint=None,
                    joint_name="",
                    s=None,
                    t=None,
                    length=contour,
                    contour=contour,
                )

    return tuple(sorted(found(), key=lambda x: -x.share))
