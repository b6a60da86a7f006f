"""Set-points of a motion that tells what a log did not."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm, Limits
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.identification.bodies.fitting import expected_fit
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import Unknown
from armcontour.identification.bodies.precision import reachable, told
from armcontour.identification.bodies.results import RobotIdentification
from armcontour.motion import Log, TaughtData, Trajectory
from armcontour.motion.laws import Law

# Highest frequencies of the motions that are tried [Hz], and lines of each.
HIGHEST = (0.4, 0.8, 1.6)
LINES = 12
# Time in which a motion begins and ends [s].
RAMP = 1.0
# Share of the limits of velocity, acceleration, torque and tool speed that it uses.
SHARE = 0.8
# Angles below this share of what is asked for are not proposed.
LEAST = 1e-3
# Step of the simulations by which motions are compared [s].
STEP = 5e-3
SEED = 0
SETTLED = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Excitation:
    """A motion that tells what logs did not.

    Args:
        taught: The set-points; they begin and end at rest where the first log began.
        tells: What it would tell, of `RobotIdentification.open`.
        leaves: What it would not tell either.
    """

    taught: TaughtData
    tells: tuple[str, ...]
    leaves: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WaveLaw(Law):
    """Sines about a position, which begin and end at rest.

    Args:
        breaks: 0 and the duration [s], (2,).
        home: The position [rad], (dof,).
        sine, cosine: Amplitudes [rad], (lines, dof).
        rate: Angular frequencies [rad/s], (lines,).
    """

    breaks: FloatArray
    home: FloatArray
    sine: FloatArray
    cosine: FloatArray
    rate: FloatArray

    def __post_init__(self) -> None:
        for name in ("breaks", "home", "sine", "cosine", "rate"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Positions or derivatives [rad, rad/s, rad/s², rad/s³] at times, (..., dof)."""
        at = np.asarray(t)[..., None] * self.rate
        waves = [
            (np.sin(at + k * np.pi / 2) * self.rate**k) @ self.sine
            + (np.cos(at + k * np.pi / 2) * self.rate**k) @ self.cosine
            for k in range(order + 1)
        ]
        window = [x[..., None] for x in _window(np.asarray(t), float(self.breaks[-1]))]
        parts = (math.comb(order, k) * window[order - k] * waves[k] for k in range(order + 1))
        return np.asarray(sum(parts) + (self.home if order == 0 else 0.0))

    def scaled(self, by: FloatArray | float) -> WaveLaw:
        """The law with amplitudes times a factor, or one factor per joint."""
        return WaveLaw(
            breaks=self.breaks, home=self.home, rate=self.rate,
            sine=self.sine * by, cosine=self.cosine * by,
        )  # fmt: skip


def propose(
    found: RobotIdentification,
    *,
    limits: Limits | None = None,
    reach: float = 0.4,
    duration: float = 20.0,
    period: float = 4e-3,
) -> Excitation:
    """Set-points of a motion that tells what logs did not, within limits.

    All joints swing at once about the position where the first log began. Obstacles are not known:
    look before you run it.

    Args:
        found: The identification.
        limits: Limits of the motion; by default those of the arm. Those of joint positions,
            velocities, accelerations, jerks and torques and of the tool's speed are kept.
        reach: Largest angle from where the first log began [rad].
        duration: Duration of the motion [s].
        period: Command interval [s].

    Raises:
        InvalidInput: There is no room for a motion within the limits.
    """
    far = _checks.between("reach", reach, 1e-3, 3.0, "rad")
    span = _checks.between("duration of the motion", duration, 4.0, 200.0, "s")
    own = (found.nominal.limits if limits is None else limits).for_joints(found.nominal.dof)
    home = found.fitted[0].log.command[0]
    best: tuple[float, Excitation] | None = None
    for highest in HIGHEST:
        law = _within(_law(home, highest, span), found.arm, own, far)
        taught = TaughtData(
            period=period,
            q=law.on_interval(
                np.zeros(1, dtype=np.intp), np.arange(0, span + period / 2, period), 0
            ),
            trajectory=Trajectory(laws=(law,), method="excitation"),
            method="none",
        )
        try:
            tells, sharpness = _tells(found, law)
        except ExecutionError:
            continue
        leaves = tuple(x for x in found.open if x not in tells)
        rank = len(leaves) + sharpness
        if best is None or rank < best[0]:
            best = rank, Excitation(taught=taught, tells=tells, leaves=leaves)
    if best is None:
        raise InvalidInput("No motion within the limits can be simulated: raise them or reach.")
    return best[1]


def _window(t: FloatArray, duration: float) -> tuple[FloatArray, ...]:
    """A factor that rises from 0 to 1 and falls to 0 within RAMP, and three derivatives."""
    late = t > duration / 2
    x = np.clip(np.where(late, duration - t, t) / RAMP, 0.0, 1.0)
    sign = np.where(late, -1.0, 1.0)
    return (
        np.asarray(x**3 * (10 - 15 * x + 6 * x**2)),
        np.asarray(sign * 30 * x**2 * (1 - x) ** 2 / RAMP),
        np.asarray(60 * x * (1 - x) * (1 - 2 * x) / RAMP**2),
        np.where((x > 0) & (x < 1), sign * 60 * (1 - 6 * x * (1 - x)) / RAMP**3, 0.0),
    )


def _law(home: FloatArray, highest: float, duration: float) -> WaveLaw:
    """Waves of all joints with lines up to a frequency [Hz], of any size."""
    rng = np.random.default_rng(SEED)
    rate = 2 * np.pi * np.linspace(highest / LINES, highest, LINES)
    angle = rng.uniform(0, 2 * np.pi, (LINES, len(home)))
    return WaveLaw(
        breaks=np.array([0.0, duration]), home=home, sine=np.sin(angle), cosine=np.cos(angle),
        rate=rate,
    )  # fmt: skip


def _within(law: WaveLaw, arm: Arm, limits: Limits, reach: float) -> WaveLaw:
    """The law with the largest angles that keep the limits.

    Raises:
        InvalidInput: There is no room.
    """
    t = np.linspace(0, float(law.breaks[-1]), int(law.breaks[-1] / STEP) + 1)
    none = np.zeros(1, dtype=np.intp)
    rate, second, third = (np.abs(law.on_interval(none, t, k)) for k in (1, 2, 3))
    away = np.abs(law.on_interval(none, t, 0) - law.home)
    low, high = limits.joint_range(arm.dof)
    room = np.minimum(np.minimum(law.home - low, high - law.home), reach)
    size = SHARE * room / away.max(axis=0)
    for most, used in (
        (limits.joint_velocity, rate),
        (limits.joint_acceleration, second),
        (limits.joint_deceleration, second),
        (limits.joint_jerk, third),
    ):
        if most is not None:
            size = np.minimum(size, SHARE * most / used.max(axis=0))
    law = law.scaled(np.maximum(size, 0.0))
    while True:
        q, dq, ddq = (law.on_interval(none, t, k) for k in range(3))
        use = 0.0
        if limits.joint_torque is not None:
            use = float(np.max(np.abs(arm.torque(q, dq, ddq)) / limits.joint_torque))
        if limits.speed is not None:
            fastest = np.linalg.norm(arm.tool_velocity(q, dq), axis=-1).max()
            use = max(use, float(fastest) / limits.speed)
        if use <= SHARE:
            return law
        if float(np.abs(q - law.home).max()) < LEAST * reach:
            raise InvalidInput(
                "No motion about the first position of the log keeps the limits of torque and tool "
                "speed: begin elsewhere, or raise the limits."
            )
        law = law.scaled(0.8)


def _tells(found: RobotIdentification, law: WaveLaw) -> tuple[tuple[str, ...], float]:
    """What a motion would tell of what is open, and how well, from 0 to 1 for barely."""
    model, values = found.model, found.fit.trial.values
    t = np.arange(0, float(law.breaks[-1]), STEP)
    q = law.on_interval(np.zeros(1, dtype=np.intp), t, 0)
    log = Log(t=t, command=q, measured=q)
    grids = [Gridded.of(log, model.servo.interpolation, SETTLED, step=STEP)]
    ideal = expected_fit(model, grids, values, found.fit.scatter)
    limit = reachable(model, values)
    known = told(model, ideal, ideal.free, limit, noise_only=True)
    names = {_name(found, x): bool(y) for x, y in zip(model.unknowns, known, strict=True)}
    sd = np.sqrt(1 / np.maximum(np.sum(ideal.jacobian**2, axis=(0, 1)), 1e-300))
    sharpness = float(np.max(np.minimum(sd / limit, 1.0)))
    return tuple(x for x in found.open if names.get(x, False)), sharpness


def _name(found: RobotIdentification, x: Unknown) -> str:
    """The name of an unknown as in `RobotIdentification.open`."""
    if x.name == "payload_center":
        return f"payload_center_{'xyz'[x.index]}"
    return f"{x.name} of {found.joints[x.index].name}" if x.index >= 0 else x.name
