"""Results of an identification: estimates of each joint, and the servo model made of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._describing import brief, digits, line_up
from armcontour.errors import InvalidInput
from armcontour.identification.correlation import WHITE
from armcontour.motion.log import Log
from armcontour.servo import ServoModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """The estimate of one parameter.

    Args:
        name: "kp", "kv", "dead_time" or "acceleration".
        unit: Unit of the value.
        value: The most likely value; nan if there is none.
        sd: Standard deviation; nan if there is none.
        low, high: Ends of the 95 % interval; of an acceleration limit that the log does not
            show, `low` is the lowest one that it leaves possible.
        determined: Whether the log determines it: `sd` is at most 10 % of the value, of a dead
            time at most 10 % or 0.5 ms.
        advice: Why the log does not determine the parameter, and which motion would.
    """

    name: str
    unit: str
    value: float
    sd: float
    low: float
    high: float
    determined: bool
    advice: str = ""

    @property
    def shown(self) -> tuple[float, str]:
        """The factor and the unit with which it is shown: times in ms."""
        return (1e3, "ms") if self.unit == "s" else (1.0, self.unit)

    @property
    def words(self) -> str:
        """Value, standard deviation and unit as text; times in ms."""
        if math.isnan(self.value):
            return f"above {self.low:.4g} {self.unit}" if self.low > 0 else "not found"
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
        noise: Standard deviation of the residuals [rad].
        rms: Root mean square of the residuals [rad].
        r_squared: Part of the variance of the measured positions that the model explains.
        whiteness: Probability that white noise is as correlated as the residuals.
        bic: Bayes's information criterion of each model that was fitted; smaller is better.
        rms_of: Residuals of each of them [rad].
        largest_demand: Largest acceleration that the model would need [rad/s²].
        saturated_time: Time at the acceleration limit [s].
        notes: Further remarks on the fit, as sentences.
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
    noise: float
    rms: float
    r_squared: float
    whiteness: float
    bic: dict[str, float]
    rms_of: dict[str, float]
    largest_demand: float
    saturated_time: float
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("t", "simulated", "residuals"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))

    def __str__(self) -> str:
        """The estimates, and how well the model fits."""
        white = "white" if self.white else "not white"
        return line_up(
            f"Servo of {self.name}, {self.order} order",
            [
                *((x.name.replace("_", " "), x.words) for x in self.estimates),
                ("residuals", f"{self.rms * 1e3:.3g} mrad RMS, {white}"),
                *(("note", x) for x in self.notes),
            ],
        )

    __repr__ = brief

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The estimates of all parameters."""
        return self.kp, self.kv, self.dead_time, self.acceleration

    @property
    def white(self) -> bool:
        """Whether the model explains all but white noise."""
        return self.whiteness >= WHITE


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
            rms = f"{joint.rms * 1e3:.3g} mrad{'' if joint.white else ', not white'}"
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
        return all(x.determined for joint in self.joints for x in _needed(joint))

    def servo_model(self) -> ServoModel:
        """The servo that was identified.

        Raises:
            InvalidInput: A gain or dead time is not determined, or joints are of different order.
        """
        for joint in self.joints:
            for x in _needed(joint):
                if not x.determined:
                    raise InvalidInput(
                        f"{self.log.source} does not determine {x.name} of {joint.name}, so there "
                        f"is no servo model of it: {x.advice[:1].lower()}{x.advice[1:]}"
                    )
        orders = {x.order for x in self.joints}
        if len(orders) > 1:
            raise InvalidInput(
                f"The joints of {self.log.source} are of different order: identify them with model "
                "second, or with first."
            )
        return ServoModel(**self._servo_options(orders.pop()))

    def _servo_options(self, order: str) -> dict[str, Any]:
        given: dict[str, Any] = {
            "kp": [x.kp.value for x in self.joints],
            "interpolation": self.interpolation,
            "dead_time": [_dead_time(x, self.log.source) for x in self.joints],
            "order": order,
        }
        if order == "second":
            given["kv"] = [x.kv.value for x in self.joints]
        return given


def _needed(joint: JointIdentification) -> tuple[Estimate, ...]:
    """The estimates that a servo model needs."""
    if joint.order == "first":
        return joint.kp, joint.dead_time
    return joint.kp, joint.kv, joint.dead_time


def _dead_time(joint: JointIdentification, source: str) -> float:
    """The dead time of a servo model [s]; zero if the 95 % interval reaches below zero.

    Raises:
        InvalidInput: The whole 95 % interval is below zero.
    """
    if joint.dead_time.high < 0:
        raise InvalidInput(
            f"{source}: the dead time of {joint.name} is {joint.dead_time.value * 1e3:.3g} ms, "
            "below zero: commands are logged late, or set-points that were taken for interpolated "
            "are held (interpolation step)."
        )
    return max(joint.dead_time.value, 0.0)
