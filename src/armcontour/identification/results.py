"""Results of an identification: estimates of each joint, and the servo model made of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._describing import brief, digits, line_up
from armcontour.errors import InvalidInput
from armcontour.identification.fitting import Data, State, simulated
from armcontour.identification.starting import initial, known_from
from armcontour.motion.log import Log
from armcontour.servo import ServoModel

# A servo model predicts at least this share of the variance of each joint's tracking error.
EXPLAINS = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """The estimate of one parameter.

    Args:
        name: "kp", "kv", "dead_time" or "acceleration".
        unit: Unit of the value.
        value: The most likely value; nan if there is none.
        sd: Standard deviation; nan if there is none.
        low, high: Ends of the 95 % interval.
        determined: Whether the log determines it: `sd` is at most 10 % of the value, of a dead
            time at most 10 % or 0.5 ms.
    """

    name: str
    unit: str
    value: float
    sd: float
    low: float
    high: float
    determined: bool

    @property
    def shown(self) -> tuple[float, str]:
        """The factor and the unit with which it is shown: times in ms."""
        return (1e3, "ms") if self.unit == "s" else (1.0, self.unit)

    @property
    def words(self) -> str:
        """Value, standard deviation and unit as text; times in ms."""
        if math.isnan(self.value):
            return "not found"
        scale, unit = self.shown
        sd = f" ±{digits(self.sd * scale, 2)}" if math.isfinite(self.sd) else ""
        sure = "" if self.determined else " (open)"
        return f"{digits(self.value * scale, 5)}{sd}{f' {unit}' if unit else ''}{sure}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointIdentification:
    """The identified servo of one joint.

    Args:
        name: Name of the joint.
        order: "second": a velocity loop in a position loop; "first": a lag.
        kp, kv: Gains [1/s].
        dead_time: Time from a set-point to its effect [s].
        acceleration: Limit of the joint acceleration [rad/s²].
        start: How the log began: "rest", "held" or "moving".
        t: Times that were used [s], (n,).
        simulated: Positions of the model [rad], (n,).
        residuals: Measured less simulated [rad], (n,).
        rms: Root mean square of the residuals [rad].
        r_squared: Part of the variance of the measured positions that the model explains.
        largest_demand: Largest acceleration that the model would need [rad/s²].
        saturated_time: Time at the acceleration limit [s].
        states: Parameters by order, of the model that is chosen and of the other order.
        tracking_rms: RMS of command less measured position, about its mean [rad].
        predicted_rms: The same of measured less predicted position, in parts of the log that were
            predicted from the others [rad]; nan if nothing was fitted.
        velocity_feedforward: Velocity feed-forward; None for a model without it.
        notes: Findings, as sentences.
    """

    name: str
    order: str
    kp: Estimate
    kv: Estimate
    dead_time: Estimate
    acceleration: Estimate
    start: str
    t: FloatArray
    simulated: FloatArray
    residuals: FloatArray
    rms: float
    r_squared: float
    largest_demand: float
    saturated_time: float
    states: dict[str, State] = field(default_factory=dict)
    tracking_rms: float = math.nan
    predicted_rms: float = math.nan
    velocity_feedforward: Estimate | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("t", "simulated", "residuals"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))

    def __str__(self) -> str:
        """The estimates, the prediction error and the findings."""
        return line_up(
            f"Servo of {self.name}, {self.order} order",
            [
                *((x.name.replace("_", " "), x.words) for x in self.estimates),
                ("residuals", f"{self.rms * 1e3:.3g} mrad RMS"),
                ("prediction error", f"{self.predicted_rms * 1e3:.3g} mrad RMS"),
                *(("note", x) for x in self.notes),
            ],
        )

    __repr__ = brief

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The estimates of all parameters."""
        feed = () if self.velocity_feedforward is None else (self.velocity_feedforward,)
        return self.kp, self.kv, *feed, self.dead_time, self.acceleration

    @property
    def explained(self) -> float:
        """Share of the tracking error's variance that the model predicts, where not fitted."""
        if not self.tracking_rms > 0:
            return math.nan
        return 1 - (self.predicted_rms / self.tracking_rms) ** 2

    @property
    def determined(self) -> bool:
        """Whether gains and dead time are determined; the acceleration limit may be open."""
        needed = [self.kp, self.dead_time, *([self.kv] if self.order == "second" else [])]
        return all(x.determined for x in needed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification:
    """The identified servos of all joints of a log.

    Args:
        log: The log.
        interpolation: Interpolation of set-points that was assumed.
        joints: The result of each joint.
    """

    log: Log
    interpolation: str
    joints: tuple[JointIdentification, ...] = field(repr=False)

    def __str__(self) -> str:
        """A row for every joint."""
        names = [x.name.replace("_", " ") for x in self.joints[0].estimates]
        rows = [["joint", *names, "residuals"]]
        for joint in self.joints:
            rms = f"{joint.rms * 1e3:.3g} mrad"
            rows.append([joint.name, *(x.words for x in joint.estimates), rms])
        return line_up(
            f"Servo identified from {self.log.source}, set-points {self.interpolation}", rows
        )

    __repr__ = brief

    def __getitem__(self, name: str | int) -> JointIdentification:
        """A joint by its name, or by its number from 1."""
        for j, joint in enumerate(self.joints):
            if name in (joint.name, j + 1):
                return joint
        names = ", ".join(x.name for x in self.joints)
        raise InvalidInput(f"{self.log.source} has no joint {name!r}: its joints are {names}.")

    @property
    def determined(self) -> bool:
        """Whether gains and dead time of all joints are determined; limits may be open."""
        return all(x.determined for x in self.joints)

    def servo_model(self) -> ServoModel:
        """The servo that was identified.

        Raises:
            InvalidInput: It neither predicts more than half of the variance of a joint's tracking
                error, nor are gains and dead time of that joint determined.
        """
        for joint in self.joints:
            self._refuse_unknown(joint)
        order = "second" if any(x.order == "second" for x in self.joints) else "first"
        options: dict[str, list[float]] = {}
        for joint in self.joints:
            for name, value in self._options_of(joint, order).items():
                options.setdefault(name, []).append(value)
        return ServoModel(interpolation=self.interpolation, order=order, **options)

    def _refuse_unknown(self, joint: JointIdentification) -> None:
        """Refuse a joint whose motion the model does not predict.

        Raises:
            InvalidInput: It is one.
        """
        better = "Record a multisine around the bandwidth of its position loop."
        if not joint.states:
            why = " ".join(joint.notes)
            raise InvalidInput(
                f"{self.log.source} does not determine kp of {joint.name}. {why} {better}"
            )
        if not joint.determined and not joint.explained >= EXPLAINS:
            share = max(joint.explained, 0.0)
            raise InvalidInput(
                f"{self.log.source}: the model of {joint.name} predicts {share:.0%} of the "
                f"variance of its tracking error of {joint.tracking_rms * 1e3:.3g} mrad RMS, and "
                f"{EXPLAINS:.0%} are needed. {better}"
            )

    def _options_of(self, joint: JointIdentification, order: str) -> dict[str, float]:
        """The parameters of a servo model of a joint, for an order that all joints have."""
        state = joint.states[joint.order]
        if state.order != order and "kp" in state.fixed and self.interpolation == "linear":
            # A drive that only delays, as one with all feed-forward.
            return {
                **{"kp": state.kp, "kv": 4 * state.kp, "dead_time": max(state.delay, 0.0)},
                **{"velocity_feedforward": 1.0, "acceleration_feedforward": 1.0},
            }
        state = joint.states.get(order, state)
        found = {"kp": state.kp, "velocity_feedforward": state.feed or 0.0}
        if order == "second":
            found |= {"kv": state.kv, "acceleration_feedforward": 0.0}
        return found | {"dead_time": _dead_time(joint, state.delay, self.log.source)}

    def predict(self, log: Log) -> Prediction:
        """What the identified servo does with the commands of a log.

        Args:
            log: The log, of the same joints; it need not be one that was identified.

        A prediction begins at rest at the first command, or with the measured position and velocity
        when the first command reaches the joint, whichever fits the log better. Of a joint of which
        nothing is known, it is the command.

        Raises:
            InvalidInput: The log has other joints.
        """
        if log.dof != len(self.joints):
            raise InvalidInput(
                f"{log.source} has {log.dof} joints, but {self.log.source} has {len(self.joints)}: "
                "give a log of the same joints."
            )
        linear, positions = self.interpolation == "linear", log.command.copy()
        for j, joint in enumerate(self.joints):
            if not joint.states:
                continue
            data, known = Data.of(log, j, linear, (0.0, 0.0)), joint.states[joint.order]
            first = known_from(data, max(known.delay, 0.0))
            begin = initial(data, known.order, "moving", first)
            q0 = begin.q0 - (known.offset or 0.0)
            begins = ((0, float(data.u[0]), 0.0), (first, q0, begin.dq0))
            found = min((_run(data, known, *x) for x in begins), key=lambda x: np.std(data.y - x))
            rows = np.arange(len(data.t)) if data.rows is None else data.rows
            positions[rows[rows >= 0], j] = found[rows >= 0]
        return Prediction(log=log, positions=positions)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """What an identified servo does with the commands of a log.

    Args:
        log: The log.
        positions: Predicted positions [rad], (n, dof).
    """

    log: Log = field(repr=False)
    positions: FloatArray = field(repr=False)

    @property
    def errors(self) -> FloatArray:
        """Measured less predicted positions, about the mean of each joint [rad], (n, dof)."""
        off = self.log.measured - self.positions
        return np.asarray(off - off.mean(axis=0))

    @property
    def rms(self) -> FloatArray:
        """Root mean square of the errors of each joint [rad], (dof,)."""
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)))

    @property
    def tracking_rms(self) -> FloatArray:
        """The same of measured less commanded positions, without a prediction [rad], (dof,)."""
        return np.asarray(np.std(self.log.measured - self.log.command, axis=0))

    @property
    def explained(self) -> FloatArray:
        """Share of the tracking errors' variance that is predicted, (dof,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(1 - (self.rms / self.tracking_rms) ** 2)

    def __str__(self) -> str:
        """A row for every joint."""
        rows = [["joint", "tracking error", "predicted to", "at most", "explained"]]
        most = np.abs(self.errors).max(axis=0)
        for j, name in enumerate(self.log.joint_names):
            values = (self.tracking_rms[j], self.rms[j], most[j])
            share = f"{max(self.explained[j], 0.0):.1%}"
            rows.append([name, *(f"{x * 1e3:.3g} mrad" for x in values), share])
        return line_up(f"Prediction of {self.log.source}", rows)

    __repr__ = brief


def _run(data: Data, known: State, first: int, q0: float, dq0: float) -> FloatArray:
    """Positions of a joint that begins at a sample; before it they are those measured [rad]."""
    state = replace(known, start="moving", first=first, q0=q0, dq0=dq0)
    late = replace(state, delay=max(known.delay, 0.0))
    return np.concatenate([data.y[:first], simulated(data, late)[0][0]])


def _dead_time(joint: JointIdentification, delay: float, source: str) -> float:
    """The dead time of a servo model [s]; zero if the 95 % interval reaches below zero.

    Raises:
        InvalidInput: The whole 95 % interval is below zero.
    """
    if joint.dead_time.high < 0 and joint.dead_time.determined:
        raise InvalidInput(
            f"{source}: the dead time of {joint.name} is {joint.dead_time.value * 1e3:.3g} ms, "
            "below zero: commands are logged late, or set-points that were taken for interpolated "
            "are held (interpolation step)."
        )
    return max(delay, 0.0)
