"""What a controller may be sent: limits of set-points with their sources, and their one judge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, Frozen
from armcontour.core.sampled_data import differences, interpolate
from armcontour.motion.controller_facts import ControllerFacts
from armcontour.motion.nearest_commands import (
    BY_ORDER,
    check_command_limits,
    command_bounds,
    find_excess,
)
from armcontour.motion.trajectory import COMMAND_SLACK
from armcontour.robot import Limits

# If no limit of the acceleration is known, set-points may accelerate by this multiple of the plan's
# limit. A user reports that a UR5 stopped at 10 times the accelerations of a planning
# configuration. Joint 6 of a CRX executed 6.3 times a published planning value.
ASSUMED_FACTOR = 3.0
# Sources of limits: the plan, the user, the assumption, and none. Other sources are controllers.
PLAN = "the plan"
USER = "command_limits"
ASSUMED = "assumed"
NONE = ""
# A set-point is at a limit if it uses more than all but this share of it. At cycles from 1 ms on,
# rounding to their decimals keeps the nearest set-points below the limit by less than this share.
AT_LIMIT = 1e-3
ACCELERATION = BY_ORDER.index("joint_acceleration")
NO_BOUND = np.array([[-np.inf], [np.inf]])


class SetPointExcess(NamedTuple):
    """The largest excess of set-points over one limit."""

    limit: str  # Name of the limit, such as "joint_velocity" or "joint_upper"
    source: str  # Source of the limit, as in `SetPointRule.sources`
    joint: int
    t: float  # Time since the first set-point [s]
    needed: float  # The position, or the absolute value of the derivative
    allowed: float

    @property
    def ratio(self) -> float:
        """Ratio to the limit."""
        return self.needed / self.allowed

    @property
    def is_assumed(self) -> bool:
        """True if nobody states the limit."""
        return self.source == ASSUMED

    @property
    def is_range(self) -> bool:
        """True if a position is beyond an end of the joint range."""
        return self.limit not in BY_ORDER

    def describe(self, joint: str, unit: str, start: float = 0.0) -> str:
        """Write the excess as words that follow an article, without a full stop.

        - `joint`: the joint, such as "joint 2".
        - `unit`: unit of the limit.
        - `start`: time of the first set-point [s].
        """
        limit = f"{self.allowed:.6g} {unit} ({self.source})"
        time = f"at t = {start + self.t:.6g} s"
        if self.is_range:
            return (
                f"set-point of {joint} {time} is {self.needed:.6g} {unit}, beyond its {self.limit} "
                f"of {limit}"
            )
        what = self.limit.removeprefix("joint_")
        article = "an" if what == "acceleration" else "a"
        return (
            f"set-points of {joint} have {article} {what} of {self.needed:.6g} {unit} {time}, "
            f"{self.ratio:.3g} times the limit of {limit}"
        )

    @property
    def remedy(self) -> str:
        """What to do, as a sentence."""
        if self.is_range:
            return "Plan a motion that is farther from this end of the range."
        if self.is_assumed:
            return (
                "No limit of your controller is known. If it accepts more, specify "
                "command_limits.joint_acceleration (inf for no limit). Otherwise compensate by the "
                "method inverse at the controller's cycle, whose set-points keep the limit, or "
                "plan a slower motion."
            )
        return "Compensate by the method inverse, or plan a slower motion."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SetPointRule(Frozen):
    """Constant limits of set-points, at the cycle at which a controller reads them.

    The derivatives of set-points are their differences over the controller's cycle. Set-points that
    come less often than the controller reads them are joined by lines.

    Args:
        bounds: Lower and upper bounds of positions, velocities, accelerations and jerks [rad,
            rad/s, rad/s², rad/s³], (4, 2, dof); infinite without a limit.
        sources: Sources of the limits of each order, (4,): PLAN, USER, ASSUMED, the title of a
            controller, or NONE; several if they limit different joints or directions.
        plan: Bounds of the plan, to which percentages refer, (4, 2, dof).
        cycle: Cycle at which the controller reads [s]; None for that of the set-points.
    """

    bounds: FloatArray
    sources: tuple[str, ...]
    plan: FloatArray
    cycle: float | None = None

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> SetPointRule:
        """Return the rule of the data that `data` returned, also after JSON."""
        return cls(
            bounds=_bounds_of_data(data["bounds"]),
            sources=tuple(data["sources"]),
            plan=_bounds_of_data(data["plan"]),
            cycle=data["cycle"],
        )

    def data(self) -> dict[str, Any]:
        """Return the fields by their names, for JSON; infinite numbers become null."""
        return {x.name: getattr(self, x.name) for x in fields(self)}

    @property
    def has_own_limits(self) -> bool:
        """True if the user or a controller limits the set-points, and not only the plan."""
        limited = [bool(np.isfinite(x).any()) for x in self.bounds]
        used = {x for x, is_used in zip(self.sources, limited, strict=True) if is_used}
        return bool(used - {PLAN, ASSUMED, NONE})

    def without_limits(self) -> SetPointRule:
        """Return the rule without any limit."""
        bounds = np.broadcast_to(NO_BOUND, self.bounds.shape)
        return replace(self, bounds=bounds, sources=(NONE,) * len(BY_ORDER))

    def without_assumed(self) -> SetPointRule:
        """Return the rule without an assumed limit."""
        if self.sources[ACCELERATION] != ASSUMED:
            return self
        bounds = self.bounds.copy()
        bounds[ACCELERATION] = NO_BOUND
        sources = list(self.sources)
        sources[ACCELERATION] = NONE
        return replace(self, bounds=bounds, sources=tuple(sources))

    def within(self, limits: Limits, source: str) -> SetPointRule:
        """Return the rule within further limits of set-points. They replace assumed ones.

        A limit that is removed (infinite) replaces an assumed one, too.

        - `source`: source of the limits.
        """
        bounds = command_bounds(limits, self.bounds.shape[2])
        rule = self._tightened(bounds, source)
        sources = list(rule.sources)
        unlimited = rule.bounds.copy()
        for order, name in enumerate(BY_ORDER):
            if name in limits.removed and sources[order] in (ASSUMED, NONE):
                unlimited[order] = NO_BOUND
                sources[order] = source
        return replace(rule, bounds=unlimited, sources=tuple(sources))

    def of_controller(self, controller: ControllerFacts) -> SetPointRule:
        """Return the rule within the limits of a controller, at its cycle."""
        bounds = command_bounds(controller.limits, self.bounds.shape[2])
        for order, factor in (1, controller.velocity_factor), (2, controller.acceleration_factor):
            if factor is not None:
                bounds[order] = intersection(bounds[order], factor * self.plan[order])
        cycles = [x for x in (self.cycle, controller.cycle) if x is not None]
        rule = self._tightened(bounds, controller.title)
        return replace(rule, cycle=min(cycles, default=None))

    def _tightened(self, bounds: FloatArray, source: str) -> SetPointRule:
        """Return the rule within further bounds, (4, 2, dof), which replace assumed ones."""
        tightened = self.bounds.copy()
        sources = list(self.sources)
        for order, given in enumerate(bounds):
            if not np.isfinite(given).any():
                continue
            if sources[order] == ASSUMED:
                tightened[order] = NO_BOUND
            narrower = intersection(tightened[order], given)
            changed = narrower != tightened[order]
            if changed.any():
                remains = (np.isfinite(narrower) & ~changed).any()
                sources[order] = f"{sources[order]}, {source}" if remains else source
            tightened[order] = narrower
        return replace(self, bounds=tightened, sources=tuple(sources))

    def at_cycle(self, cycle: float) -> FloatArray:
        """Return bounds on set-points at a cycle, so that the controller reads no excess.

        Over the time h between set-points, the acceleration may be at most the smaller of
        `A c / h` and `J c² / h / max(1, 3 - h / c)`, with the controller's cycle c <= h and its
        limits A and J: it reads lines, whose velocity changes by Δv at a set-point within one
        cycle c. So it reads an acceleration of Δv / c and a jerk of Δv / c². If h < 2 c, it may
        read two opposite changes within three cycles, and then a jerk of (3 - h / c) Δv / c².

        - `cycle`: time h between set-points [s].
        """
        read = self.cycle
        if read is None or read >= cycle * (1 - COMMAND_SLACK):
            return self.bounds
        bounds = self.bounds.copy()
        from_acceleration = self.bounds[2] * read / cycle
        from_jerk = self.bounds[3] * read**2 / cycle / max(1.0, 3.0 - cycle / read)
        bounds[2] = intersection(from_acceleration, from_jerk)
        bounds[3] = NO_BOUND
        return bounds

    def judge(self, q: FloatArray, cycle: float) -> SetPointUse:
        """Compare set-points with the limits, at the cycle at which the controller reads.

        - `q`: set-points [rad], (n, dof), at rest before and after.
        - `cycle`: their cycle [s].
        """
        read = self.cycle or cycle
        if abs(read - cycle) > COMMAND_SLACK * cycle:
            t = np.arange(len(q), dtype=np.float64) * cycle
            count = int(np.ceil(t[-1] / read - COMMAND_SLACK)) + 1
            q = interpolate(np.arange(count, dtype=np.float64) * read, t, q)
        ratios = {}
        plan_ratios = {}
        excesses = []
        limited = np.zeros(len(q) + len(BY_ORDER), dtype=bool)
        for order, name in enumerate(BY_ORDER):
            only = np.broadcast_to(NO_BOUND, self.bounds.shape).copy()
            only[order] = self.bounds[order]
            excess = find_excess(q, read, only)
            if excess is not None:
                excesses.append(
                    SetPointExcess(
                        limit=excess.name,
                        source=self.sources[order],
                        joint=excess.joint,
                        t=excess.row * read,
                        needed=excess.needed,
                        allowed=excess.allowed,
                    )
                )
            if not order:
                continue
            values = differences(q, order) / read**order
            if np.isfinite(self.bounds[order]).any():
                use = _ratio(values, self.bounds[order])
                ratios[name] = use.max(axis=0, initial=0.0)
                limited[: len(use)] |= (use > 1 - AT_LIMIT).any(axis=1)
            if np.isfinite(self.plan[order]).any():
                plan_ratios[name] = _ratio(values, self.plan[order]).max(axis=0, initial=0.0)
        return SetPointUse(
            rule=self,
            ratios=ratios,
            plan_ratios=plan_ratios,
            excesses=tuple(excesses),
            limited_share=float(limited[: len(q)].mean()),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SetPointUse:
    """How far set-points use their limits.

    Args:
        rule: The limits.
        ratios: Largest ratio to each limit of a derivative by its name, (dof,).
        plan_ratios: Largest ratio to the plan's limit of each derivative by its name, (dof,).
        excesses: The largest excess over each limit that is exceeded; positions first.
        limited_share: Share of the cycles in which a limit of a derivative is reached.
    """

    rule: SetPointRule
    ratios: Mapping[str, FloatArray]
    plan_ratios: Mapping[str, FloatArray]
    excesses: tuple[SetPointExcess, ...]
    limited_share: float

    @property
    def stated_excess(self) -> SetPointExcess | None:
        """The first excess over a limit that the plan, the user or a controller states."""
        return next((x for x in self.excesses if not x.is_assumed), None)


def make_rule(
    plan: Limits,
    dof: int,
    command_limits: Limits | None = None,
    controllers: Sequence[ControllerFacts] = (),
) -> SetPointRule:
    """Make the rule of a plan's set-points: the smallest of all limits counts.

    Without another limit of the acceleration, ASSUMED_FACTOR times that of the plan is assumed.

    - `plan`: limits of the plan.
    - `dof`: number of joints.
    - `command_limits`: the user's limits of set-points.
    - `controllers`: controllers that get the set-points.

    Raises:
        InvalidInput: `command_limits` has a limit that is not one of set-points.
    """
    of_plan = command_bounds(plan, dof)
    bounds = of_plan.copy()
    bounds[ACCELERATION] *= ASSUMED_FACTOR
    # The jerk of the plan limits its joints, not the set-points.
    bounds[3] = NO_BOUND
    sources = [PLAN if np.isfinite(x).any() else NONE for x in bounds]
    if sources[ACCELERATION]:
        sources[ACCELERATION] = ASSUMED
    rule = SetPointRule(bounds=bounds, sources=tuple(sources), plan=of_plan)
    if command_limits is not None:
        rule = rule.within(check_command_limits(command_limits, dof), USER)
    for controller in controllers:
        rule = rule.of_controller(controller)
    return rule


def _bounds_of_data(data: Any) -> FloatArray:
    """Return bounds, (4, 2, dof), in whose data infinite numbers are None."""
    bounds = np.array(data, dtype=np.float64)
    return np.where(np.isnan(bounds), NO_BOUND, bounds)


def intersection(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the tighter of two pairs of bounds, (2, dof)."""
    return np.stack([np.maximum(first[0], second[0]), np.minimum(first[1], second[1])])


def _ratio(values: FloatArray, bounds: FloatArray) -> FloatArray:
    """Return the ratios of values to the bound in their direction, (n, dof)."""
    return np.asarray(np.maximum(values / bounds[0], values / bounds[1]))
