"""Model of joint servos: the paper's two loops (5)-(7), a P-PI cascade, a lag or a delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.lazy import load_method
from armcontour.core.quantities import (
    DEAD_TIME,
    AtLeast,
    Choice,
    Named,
    OwnAccelerations,
    Quantity,
    list_values,
)

INTERPOLATIONS = ("linear", "step", "cubic")
ORDERS = ("second", "first", "delay", "unknown")
# Smallest and largest gain [1/s], for time constants from a microsecond to a quarter of an hour. No
# robot joint is faster or slower, and no result overflows.
GAINS = (1e-3, 1e6)
# Smallest and largest inertia of a joint [kg m²], from a milligram at 1 cm to ten tonnes at 10 m.
INERTIAS = (1e-10, 1e6)
# Largest feed-forward factor; no drive commands three times the velocity of its set-points.
MAX_FEEDFORWARD = 3.0
# Longest cycle of a drive's loop [s].
LONGEST_CYCLE = 0.02
# Largest dry friction, as a position error [rad].
MAX_FRICTION = 0.1
# Command velocity at which friction has 71 % of its full value [rad/s].
SLIDING = 5e-3
# Largest dead time [s]. Set-points are sent earlier by the dead time, so the robot waits for it.
LONGEST_DEAD_TIME = 60.0
# Largest number of time constants in a cycle. With more, the joint comes to rest long before the
# next set-point, and the simulation needs a step for each half of a time constant.
MAX_TIME_CONSTANTS = 1000.0
# Ratio of the RMS contour errors with and without compensation on validation data, above which
# compensation may be worse than none on other programs.
TRUSTED = 0.5
# Valid range of logged velocities and accelerations [rad/s, rad/s²].
LOGGED = (0.0, 1e6)
# Motions that exceed a logged value by more than this factor cause a warning.
EXCEEDED = 1.02
# Largest ratio between the frequencies of logs and motion, because errors in fast reversals do not
# bound errors in slow motion. In simulations of random plants, the bounds held for
# frequency ratios up to 10, and often not above 16.
MAX_FREQUENCY_RATIO = 13.0
# A joint moves if its largest velocity is at least this fraction of the fastest joint's.
MOVING_SHARE = 0.1
# Maximum length of the text about where a servo comes from [characters].
LONGEST_SOURCE = 300
# Parameters with one value per joint.
PER_JOINT = (
    *("kp", "kv", "acceleration_limit", "ki", "dead_time", "inertia", "velocity_feedforward"),
    *("acceleration_feedforward", "friction", "offset", "model_error", "logged_velocity"),
    *("logged_acceleration", "logged_frequency"),
)

Gains = Annotated[FloatArray, Quantity("1/s", "25 1/s", "positive", endless=True, within=GAINS)]
FeedForwards = Annotated[FloatArray, Quantity("1", "100 %", within=(0.0, MAX_FEEDFORWARD))]
Spread = Annotated[float, Quantity("1", "2 %", "share")]
AngularErrors = Annotated[FloatArray, Quantity("rad", "0.1 mrad", within=(0.0, np.pi))]


@declared(eq=False)
class ServoModel(Checked):
    """Model of the joint servos: response of each joint to its command u, with dead time `tau`.

    - order "second": `ddq = K_v (K_p (u - q) + f du - dq) + g ddu`, a velocity loop inside a
      position loop; with f = g = 0 it is (6) of the paper. An integral gain k_i makes it the P-PI
      cascade `ddq = K_v (1 + k_i / s) (K_p (u - q) + f du - dq) + g ddu`;
    - order "first": `dq = K_p (u - q) + f du + g ddu`, a first-order lag, for a very fast velocity
      loop;
    - order "delay": `q = u`;
    - order "unknown": dead time only. Compensation uses the plan as set-points, and the simulated
      joint follows the set-points exactly, both with the dead time.

    u, du and ddu are delayed by tau, and dry friction reduces u by `c sign(du)`. In a P-PI cascade
    friction is the acceleration `-K_p K_v c sign(du)`, which bypasses the integrator. In saturation
    the integrator integrates the velocity error minus the excess of the demand over K_v
    (anti-windup by back-calculation with the gain k_i). Between two set-points the command is, by
    interpolation,

    - "linear": the straight line;
    - "step": the earlier set-point (zero-order hold);
    - "cubic": the cubic with slopes `(u[k + 1] - u[k - 1]) / (2 T)` at set-points, and 0 at the
      first and the last one (Catmull-Rom spline: continuously differentiable, and local).

    Before the first set-point, the command equals the first set-point, and after the last one it
    equals the last set-point; du and ddu are 0. The rates of the command are, by interpolation,

    - "linear": du is the slope of the line, and ddu the second difference of the set-points that
      end it, `(u[k] - 2 u[k - 1] + u[k - 2]) / T²`;
    - "step": du is the difference from the previous set-point over the cycle; ddu is unavailable;
    - "cubic": the derivatives of the cubic.

    With a drive cycle, the loop is computed once per cycle, from command and state at its start.
    The acceleration (order "second") or velocity ("first") is constant in the cycle, and du and ddu
    are differences of u over cycles. The integral then includes the velocity error of that cycle.

    The command passes each set-point at its time. A controller must know the next set-point for a
    line, and also the set-point after it for the cubic; this delay is part of the dead time.

    >>> model = ac.ServoModel(kp=25.0, kv=150.0, dead_time=4e-3)
    >>> model.replace(velocity_feedforward=1.0).kp
    array(25.)

    Args:
        kp: Position loop gain [1/s], one for all joints or one per joint; infinite for joints of
            order "delay" or "unknown".
        kv: Velocity loop gain [1/s], one for all joints or one per joint; infinite for joints of
            another order than "second", and None if all are.
        interpolation: Interpolation between set-points: "linear", "step" or "cubic".
        dead_time: Delay from the time of a set-point until it reaches the servo [s], one for all
            joints or one per joint; need not be a multiple of the cycle.
        order: "second", "first", "delay" or "unknown", one for all joints or one per joint.
        inertia: Inertia J by which the controller scales the velocity loop [kg m²], one for all
            joints or one per joint. The torque is J times the acceleration that the model of order
            "second" demands. Only for rigid bodies and servos of order "second". None is the
            nominal inertia of the arm.
        ki: Integral gain k_i of the velocity loop [1/s], one for all joints or one per joint; 0
            without an integrator. Only for order "second".
        velocity_feedforward: Factor f of the command velocity that is added to the velocity loop,
            one for all joints or one per joint: 0 for the paper's servo, about 1 for most
            industrial drives.
        acceleration_feedforward: Factor g of the command acceleration that is added to the demand,
            one for all joints or one per joint; a time [s] for order "first". Positive only with
            velocity feed-forward, and not for interpolation "step".
        friction: Position error c due to dry friction [rad], one for all joints or one per joint.
        acceleration_limit: Acceleration at which a joint of order "second" saturates [rad/s²], one
            for all joints or one per joint; infinite without saturation. None is the limit
            joint_acceleration of the robot.
        drive_cycle: Time between two computations of the drives' loops [s]; 0 for continuous loops.
        offset: Mean static deviation of the measured positions from this model [rad], one for all
            joints or one per joint. It is not compensated, because it can be an offset of the
            encoder.
        model_error: Largest error of this model on measured motion to which it was not fitted, plus
            `offset` [rad], one for all joints or one per joint; None if it is not known.
        logged_velocity: Largest velocity [rad/s] of the motion on which `model_error` was
            determined, one for all joints or one per joint; None if it is not known.
        logged_acceleration: Largest acceleration of that motion [rad/s²], one for all joints or one
            per joint; None if it is not known.
        logged_frequency: Smallest joint frequency in one of that motion's logs [1/s], which is the
            joint's largest acceleration divided by its largest velocity; None if it is not known.
            Then `logged_acceleration` divided by `logged_velocity` replaces it.
        contour_ratio: RMS contour error with compensation over that without it, on measured motion
            to which the model was not fitted, in the worst log; None if it is not known.
        program_ratio: The same in the worst of the logs that reverse about as slowly as the slowest
            log, such as programs in contrast to multisines; None if it is not known. Then
            `contour_ratio` replaces it.
        programs: Number of programs on which contour_ratio was determined; None if it is not known.
        kp_spread: Relative standard deviation of kp between joints and robots, as measured; None if
            it is not known.
        kv_spread: The same for kv.
        source: Where the values come from, in one line, such as "identified on 2026-11-30 from
            A.csv"; empty for assumed values.

    Raises:
        InvalidInput: A gain or an inertia is missing, not needed or out of range; a dead time is
            negative or above LONGEST_DEAD_TIME; a feed-forward is negative, above MAX_FEEDFORWARD
            or not possible; friction, acceleration limit or cycle are out of range; the
            interpolation or order is unknown.
    """

    kp: Gains
    kv: Gains | None
    ki: Annotated[FloatArray, Quantity("1/s", "5 1/s", within=(0.0, GAINS[1]))]
    order: Annotated[str | tuple[str, ...], Choice(ORDERS)]
    dead_time: Annotated[FloatArray, replace(DEAD_TIME, within=(0.0, LONGEST_DEAD_TIME))]
    interpolation: Annotated[str, Choice(INTERPOLATIONS)]
    inertia: Annotated[FloatArray, Quantity("kg m^2", "1.2 kg m^2", within=INERTIAS)] | None
    velocity_feedforward: FeedForwards
    acceleration_feedforward: FeedForwards
    friction: Annotated[FloatArray, Quantity("rad", "0.1 mrad", within=(0.0, MAX_FRICTION))]
    acceleration_limit: OwnAccelerations | None
    drive_cycle: Annotated[float, Quantity("s", "4 ms", within=(0.0, LONGEST_CYCLE))]
    offset: Annotated[FloatArray, Quantity("rad", "0.1 mrad", within=(-np.pi, np.pi))]
    model_error: AngularErrors | None
    logged_velocity: Annotated[FloatArray, Quantity("rad/s", "1.5 rad/s", within=LOGGED)] | None
    logged_acceleration: (
        Annotated[FloatArray, Quantity("rad/s^2", "8 rad/s^2", within=LOGGED)] | None
    )
    logged_frequency: Annotated[FloatArray, Quantity("1/s", "8 1/s", within=LOGGED)] | None
    contour_ratio: Annotated[float, Quantity("1", "40 %", within=(0.0, 1e9))] | None
    program_ratio: Annotated[float, Quantity("1", "40 %", within=(0.0, 1e9))] | None
    programs: Annotated[int, AtLeast(1, 10**9)] | None
    kp_spread: Spread | None
    kv_spread: Spread | None
    source: Annotated[str, Named(LONGEST_SOURCE)]

    def __init__(
        self,
        kp: npt.ArrayLike = np.inf,
        kv: npt.ArrayLike | None = None,
        *,
        ki: npt.ArrayLike = 0.0,
        interpolation: str = "linear",
        dead_time: npt.ArrayLike = 0.0,
        order: str | Sequence[str] = "second",
        inertia: npt.ArrayLike | None = None,
        velocity_feedforward: npt.ArrayLike = 0.0,
        acceleration_feedforward: npt.ArrayLike = 0.0,
        friction: npt.ArrayLike = 0.0,
        acceleration_limit: npt.ArrayLike | None = None,
        drive_cycle: float = 0.0,
        offset: npt.ArrayLike = 0.0,
        model_error: npt.ArrayLike | None = None,
        logged_velocity: npt.ArrayLike | None = None,
        logged_acceleration: npt.ArrayLike | None = None,
        logged_frequency: npt.ArrayLike | None = None,
        contour_ratio: float | None = None,
        program_ratio: float | None = None,
        programs: int | None = None,
        kp_spread: float | None = None,
        kv_spread: float | None = None,
        source: str = "",
    ) -> None:
        arguments = locals()
        for parameter in fields(self):
            object.__setattr__(self, parameter.name, arguments[parameter.name])
        self.__post_init__()

    def _check_together(self) -> None:
        """Check that gains and feed-forward fit the orders; complete gains that a joint lacks."""
        orders = (self.order,) if isinstance(self.order, str) else self.order
        same = len(set(orders)) == 1
        second = np.array([x == "second" for x in orders])
        lagged = second | np.array([x == "first" for x in orders])
        if self.kv is None and second.any():
            raise InvalidInput(
                "A servo of order second requires the velocity loop gain kv [1/s] and kp."
            )
        if self.kv is not None and not second.any():
            raise InvalidInput(
                f"A servo of order {orders[0]} has no velocity loop, so remove its gain kv."
            )
        if self.inertia is not None and not second.all():
            lagging = orders[int(np.argmin(second))]
            raise InvalidInput(
                f"A servo of order {lagging} has no velocity loop, so remove its inertia."
            )
        feed = self.acceleration_feedforward
        _check_integrator(self.ki, second, self.interpolation, feed)
        if feed.any() and self.interpolation == "step":
            raise InvalidInput(
                "A servo with held set-points has no command acceleration. Remove "
                "acceleration_feedforward."
            )
        if ((feed > 0) & (self.velocity_feedforward == 0)).any():
            raise InvalidInput(
                "acceleration_feedforward without velocity_feedforward would cause long "
                "oscillations. Also specify velocity_feedforward, such as 1."
            )
        object.__setattr__(self, "order", orders[0] if same else orders)
        object.__setattr__(self, "kp", _check_gain("kp", self.kp, lagged, same))
        if self.kv is not None:
            object.__setattr__(self, "kv", _check_gain("kv", self.kv, second, same))

    @classmethod
    def preset(cls, name: str) -> ServoModel:
        """Load the measured servo of a controller by its name.

        >>> print(ac.ServoModel.preset("ur5e-servoj"))
        kp 9.72 1/s, kv 28.8 1/s

        Args:
            name: Name of the servo; a job loads it with `servo: ur5e-servoj`.

        Raises:
            InvalidInput: No servo has this name; the message lists the names.
        """
        servo: ServoModel = load_method("servo_preset")(name)
        return servo

    def __str__(self) -> str:
        """Write gains, dead time and feed-forward, such as "kp 25 1/s, kv 150 1/s"."""
        return self.describe(())

    @checked
    def describe(self, prismatic: Sequence[bool] | None) -> str:
        """Return the text of the servo with units for the joints of an arm.

        Args:
            prismatic: Whether each joint is prismatic; None or empty if no joint is.

        Raises:
            InvalidInput: `prismatic` is not a sequence of truth values.
        """
        slides = () if prismatic is None else prismatic
        parts = [] if self.order == "second" else [f"order {_join_texts(self.order)}"]
        rows = [(x, "1/s", 1.0) for x in ("kp", "kv", "ki")] + [("dead_time", "ms", 1e3)]
        rows += [("velocity_feedforward", "", 1.0), ("acceleration_feedforward", "", 1.0)]
        rows += [("friction", "mrad", 1e3), ("acceleration_limit", "rad/s²", 1.0)]
        for name, unit, scale in [*rows, ("drive_cycle", "ms", 1e3)]:
            values = getattr(self, name)
            if values is None or not np.any(np.isfinite(values) & (values > 0)):
                continue
            words = name.replace("_", " ").replace("feedforward", "feed-forward")
            texts = [f"{x:g}" if np.isfinite(x) else "none" for x in np.atleast_1d(values * scale)]
            parts.append(f"{words} {list_values(texts, unit, slides)}")
        return ", ".join(parts)

    @checked
    def describe_with_source(self, prismatic: Sequence[bool] | None) -> str:
        """Return the text of the servo, and whether it is assumed or where it comes from.

        >>> ac.ServoModel(kp=25.0, kv=150.0).describe_with_source(None)
        'assumed servo: kp 25 1/s, kv 150 1/s'

        Args:
            prismatic: As in `describe`.

        Raises:
            InvalidInput: As in `describe`.
        """
        owner = f"servo ({self.source})" if self.source else "assumed servo"
        return f"{owner}: {self.describe(prismatic)}"

    def for_joints(self, dof: int) -> ServoModel:
        """Return the servo with one value per joint for each parameter that may vary by joint.

        Args:
            dof: Number of joints.

        Raises:
            InvalidInput: The number of gains, dead times or inertias is not 1 or `dof`.
        """
        dof = checks.check_int("dof", dof, 1, checks.MAX_JOINTS)
        values = [getattr(self, x) for x in PER_JOINT]
        if all(x is None or x.shape == (dof,) for x in values) and isinstance(self.order, str):
            return self
        if self.source and self.kp.ndim and self.kp.size != dof:
            raise ArmMismatch(
                f"The servo ({self.source}) has {self.kp.size} joints, but the arm has {dof}. "
                f"Specify gains with one value, or a list of {dof} values, such as "
                f"{{kp: 25 1/s, kv: 150 1/s}}. The gains of this servo: {self.describe(None)}."
            )
        changes: dict[str, Any] = {}
        for name in PER_JOINT:
            values = getattr(self, name)
            if values is None:
                continue
            if values.ndim:
                # `per_joint` checks the number of values, but rejects infinite values, which are
                # valid here.
                checks.per_joint(name, np.where(np.isinf(values), 0.0, values), dof)
            changes[name] = np.full(dof, values)
        if not isinstance(self.order, str) and len(self.order) != dof:
            raise ArmMismatch(
                f"order of the servo has {len(self.order)} values, but the arm has {dof} joints. "
                f"Specify one value for all joints or {dof} values."
            )
        return self.replace(**changes)

    def replace(self, **changes: Any) -> ServoModel:
        """Return the servo with other values of some parameters.

        Args:
            changes: New values by the names of the constructor's parameters.

        Raises:
            InvalidInput: A name is unknown, or a value is invalid for the constructor.
        """
        values = {x.name: getattr(self, x.name) for x in fields(self)}
        return ServoModel(**{**values, **changes})

    @property
    def doubt(self) -> str:
        """Warning that compensation may be worse than none; empty for a trusted model."""
        reasons = []
        if self.contour_ratio is not None and self.contour_ratio > TRUSTED:
            reasons.append(
                f"{self.contour_ratio:.0%} of the contour error remain on data to which the servo "
                f"was not fitted (more than {TRUSTED:.0%})"
            )
        if self.programs == 1:
            reasons.append("the servo was evaluated on one program only")
        if not reasons:
            return ""
        return (
            f"Compensation may be worse than none, because {' and '.join(reasons)}. Identify the "
            "servo from more programs, or use the compensation none."
        )

    def describe_excess(self, dq: FloatArray, ddq: FloatArray) -> str:
        """Return a warning if a motion exceeds the motion that determined `model_error`, or "".

        Args:
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof).
        """
        if self.model_error is None:
            return ""
        excesses = []
        for name, values, logged in (
            ("velocity", dq, self.logged_velocity),
            ("acceleration", ddq, self.logged_acceleration),
        ):
            if logged is None or not len(values):
                continue
            ratios = np.abs(values).max(axis=0) / np.maximum(logged, 1e-9)
            j = int(np.argmax(ratios))
            if ratios[j] > EXCEEDED:
                excesses.append(f"joint {j + 1} has {ratios[j]:.3g} times the largest {name}")
        if not self.is_similar(dq, ddq):
            excesses.append("the motion reverses much more slowly than the motion")
        if not excesses:
            return ""
        return (
            "The error bound of the servo model is valid only for motion as in its logs, but "
            f"{' and '.join(excesses)} in the logs. Identify the servo from logs of this motion."
        )

    def is_similar(self, dq: FloatArray, ddq: FloatArray) -> bool:
        """Return whether one of the logs contains motion that reverses about as slowly as this.

        The frequency of a joint is its largest acceleration divided by its largest velocity. At
        least one moving joint must have a frequency of at least that in one of the logs divided by
        MAX_FREQUENCY_RATIO.

        Args:
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof).
        """
        if self.logged_velocity is None or self.logged_acceleration is None or not len(dq):
            return True
        velocity = np.abs(dq).max(axis=0)
        acceleration = np.abs(ddq).max(axis=0)
        logged = self.logged_frequency
        if logged is None:
            logged = self.logged_acceleration / np.maximum(self.logged_velocity, 1e-9)
        ratios = logged * velocity / np.maximum(acceleration, 1e-9)
        moving = velocity >= MOVING_SHARE * velocity.max()
        return bool(ratios[moving].min() <= MAX_FREQUENCY_RATIO)

    @property
    def has_feedforward(self) -> bool:
        """True if any joint has feed-forward."""
        return bool(self.velocity_feedforward.any())

    def without_feedforward(self) -> ServoModel:
        """Return the servo without velocity and acceleration feed-forward."""
        return self.replace(velocity_feedforward=0.0, acceleration_feedforward=0.0)

    @property
    def lead(self) -> tuple[FloatArray, FloatArray]:
        """Factors a [s] and b [s²] by which feed-forward changes the command, (dof,) each.

        The servo responds to u as one without feed-forward to `u + a du + b ddu`.
        """
        feed = self.velocity_feedforward, self.acceleration_feedforward
        return lead_of(self.kp, self._loops, *feed)

    @property
    def _loops(self) -> FloatArray:
        """Velocity loop gains [1/s], infinite for joints without a velocity loop."""
        return np.full_like(self.kp, np.inf) if self.kv is None else self.kv

    @property
    def slowest(self) -> float:
        """Smallest decay rate of any joint [1/s]; infinite if all joints are pure delays."""
        kp, kv = np.broadcast_arrays(self.kp, self._loops)
        # The roots of s² + kv s + kp kv have the decay rates as negative real parts. If the roots
        # are real, the rates add up to kv, and their product is kp kv.
        loop = np.isfinite(kv)
        if not loop.any():
            return float(kp.min())
        ki = np.broadcast_to(self.ki, kp.shape)[loop]
        alone = np.min(kp[~loop], initial=np.inf)
        kp = kp[loop]
        kv = kv[loop]
        root = np.sqrt(np.maximum(kv * kv / 4 - kp * kv, 0.0))
        rate = np.where(root > 0, kp * kv / (kv / 2 + root), kv / 2)
        for j in np.flatnonzero(ki):
            cascade = [1.0, kv[j], kv[j] * (kp[j] + ki[j]), kv[j] * kp[j] * ki[j]]
            rate[j] = -np.roots(cascade).real.max()
        return float(min(rate.min(), alone))

    def saturate(self, lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the servo's acceleration bounds [rad/s²], (dof,) each; infinite without a loop.

        Args:
            lower: Lower bounds of the robot [rad/s²], (dof,), used if acceleration_limit is None.
            upper: Upper bounds of the robot [rad/s²], (dof,).
        """
        if self.acceleration_limit is not None:
            upper = np.broadcast_to(self.acceleration_limit, upper.shape)
            lower = -upper
        loop = np.isfinite(self._loops)
        return np.where(loop, lower, -np.inf), np.where(loop, upper, np.inf)

    def is_plain(self, *orders: str) -> bool:
        """Return whether every joint has one of these orders, without friction and drive cycle.

        Args:
            orders: The accepted orders.
        """
        return self.order in orders and not self.friction.any() and not self.drive_cycle

    def check_orders(self, who: str, integrator: bool = False) -> None:
        """Check that all joints have order "second", without integrator, friction and cycle.

        Args:
            who: Name of the feature that requires this, which begins the message.
            integrator: True if integrators are allowed.

        Raises:
            InvalidInput: The servo does not have these properties.
        """
        if not self.is_plain("second") or (self.ki.any() and not integrator):
            suffix = "" if integrator else ", and without integrator"
            raise InvalidInput(
                f"{who} requires joint servos of order second without friction and cycle{suffix}, "
                f"but the servo has {self}. Use the compensation inverse and independent joints."
            )

    def check_gains(self, cycle: float) -> None:
        """Check that the gains are not too large for a cycle.

        Args:
            cycle: Cycle [s].

        Raises:
            InvalidInput: The cycle is longer than MAX_TIME_CONSTANTS time constants.
        """
        for name, values in (("kp", self.kp), ("kv", self._loops), ("ki", self.ki)):
            largest = float(np.max(values, initial=0.0, where=np.isfinite(values)))
            if largest * cycle > MAX_TIME_CONSTANTS:
                suffix = ", or use a servo of order first" if name == "kv" else ""
                raise InvalidInput(
                    f"servo gain {name} is {largest:g} 1/s, which is {largest * cycle:.3g} time "
                    f"constants in a cycle of {cycle:g} s, but at most "
                    f"{MAX_TIME_CONSTANTS:g} can be simulated. Reduce {name} to "
                    f"{MAX_TIME_CONSTANTS / cycle:g} 1/s, shorten the cycle{suffix}.",
                    limit=name,
                    needed=largest,
                    allowed=MAX_TIME_CONSTANTS / cycle,
                )

    def command(self, q: FloatArray, dq: FloatArray, ddq: FloatArray | None = None) -> FloatArray:
        """Return the command with which the servo follows q [rad], (n, dof).

        >>> servo.command(q=[[0.1, 1.0]], dq=[[0.5, 0.0]], ddq=[[0.0, 0.0]])
        array([[0.12, 1.  ]])

        The servo is unsaturated and has no dead time.

        Second order: `q + dq / K_p + ddq / (K_p K_v)`, from (6). First order: `q + dq / K_p`. Dry
        friction adds `c sign(dq)`. With feed-forward, the result is `u + a du + b ddu` with the
        factors of `lead`, from which `compensate` computes set-points. In a P-PI cascade ddq is the
        part of acceleration and friction that the integrator does not supply.

        Args:
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof); None only without order "second".

        Raises:
            InvalidInput: The accelerations are missing.
        """
        position = checks.floats("q", q, "rad")
        rate = checks.floats("dq", dq, "rad/s")
        acceleration = 0.0 if ddq is None else checks.floats("ddq", ddq, "rad/s²")
        try:
            np.broadcast(position, rate, acceleration, self.kp, self.friction)
        except ValueError:
            raise InvalidInput("q, dq and ddq must have one column per joint.") from None
        command = np.asarray(position + rate / self.kp + self.friction * sliding(rate))
        loops = self._loops
        # A velocity that is held for a cycle, and a difference over a cycle, are delayed by half a
        # cycle.
        delay = self.drive_cycle / 2 * (np.isinf(loops) + self.velocity_feedforward)
        factor = np.asarray((1 / loops + delay) / self.kp)
        if not factor.any():
            return command
        if ddq is None:
            raise InvalidInput("A servo of order second requires the joint accelerations ddq.")
        return command + factor * acceleration

    def response(self, s: npt.ArrayLike) -> FloatArray:
        """Return the transfer function from command to joint position at s; complex, (n, joints).

        `G(s) = exp(-s tau) (g s² + f K_v s + K_p K_v) / (s² + K_v s + K_p K_v)`, with f = g = 0
        (5), or for order "first" `exp(-s tau) (f s + K_p) / (s + K_p)`; in a P-PI cascade with
        `K_v (1 + k_i / s)` for K_v. The interpolation of set-points is not included.

        >>> abs(servo.response([1j * 10.0])).round(3)
        array([[0.95]])

        Args:
            s: Complex frequencies [rad/s], (n,).
        """
        try:
            frequency = np.asarray(s, np.complex128).reshape(-1, 1)
        except (TypeError, ValueError, OverflowError):
            raise InvalidInput("s must be complex frequencies in rad/s.") from None
        a, b = self.lead
        ki = np.atleast_1d(self.ki)
        curvature = frequency**2 * np.where(
            ki > 0, frequency / np.where(ki > 0, frequency + ki, 1.0), 1.0
        )
        response = np.exp(-frequency * np.atleast_1d(self.dead_time)) * (
            1 + frequency * a + curvature * b
        )
        slow = (
            1
            + frequency / np.atleast_1d(self.kp)
            + curvature / np.atleast_1d(self.kp * self._loops)
        )
        return np.asarray(response / slow)


def lead_of(kp: Any, kv: Any, velocity: Any, acceleration: Any) -> tuple[FloatArray, FloatArray]:
    """Return the factors of `ServoModel.lead` from gains and feed-forward factors.

    Args:
        kp: Position loop gains [1/s].
        kv: Velocity loop gains [1/s]; infinite without a velocity loop.
        velocity: Factors of the command velocity.
        acceleration: Factors of the command acceleration.
    """
    loops = np.where(np.isinf(kv), 1.0, kv)
    return np.asarray(velocity / kp), np.asarray(acceleration / (kp * loops))


def integrator_filter(ki: float, cycle: float, drive_cycle: float) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator, in z, of the filter `s / (s + ki)` for cycle means.

    The filter takes and returns means over `cycle` [s]. In a drive with the cycle `drive_cycle`
    [s], 0 for a continuous loop, the integral is a sum; the filter is exact if both are equal.
    """
    decay = np.log1p(ki * drive_cycle) / drive_cycle if drive_cycle else ki
    mean = -np.expm1(-decay * cycle) / (ki * cycle)
    return mean * np.array([1.0, -1.0]), np.array([1.0, -np.exp(-decay * cycle)])


def without_integral(
    dq: FloatArray, ddq: FloatArray, servo: ServoModel, cycle: float
) -> FloatArray:
    """Return the part of mean accelerations that the integrators do not supply [rad/s²].

    The loop output is `K_v (1 + k_i / s)` times the velocity error, starting at rest, and also
    overcomes friction.

    Args:
        dq: Mean joint velocities over intervals of length `cycle` [rad/s], (n, dof).
        ddq: Mean joint accelerations over the same intervals [rad/s²], (n, dof).
        servo: Servo with one value per joint.
        cycle: Length of the intervals [s].
    """
    if not servo.ki.any():
        return ddq
    from scipy.signal import lfilter

    assert servo.kv is not None
    reduced = ddq.copy()
    for j in np.flatnonzero(servo.ki):
        # Acceleration that overcomes dry friction
        friction = servo.kp[j] * servo.kv[j] * servo.friction[j] * sliding(dq[:, j])
        coefficients = integrator_filter(servo.ki[j], cycle, servo.drive_cycle)
        # In a drive with a cycle, feed-forward is delayed. The integrator does not change this
        # delay.
        delay = servo.kv[j] * servo.velocity_feedforward[j] * servo.drive_cycle / 2
        reduced[:, j] = lfilter(*coefficients, ddq[:, j] + friction) - friction + delay * ddq[:, j]
        reduced[:, j] /= 1 + delay
    return reduced


def sliding(rate: FloatArray) -> FloatArray:
    """Return the dry-friction factor at command velocities `rate` [rad/s], smooth from -1 to 1."""
    return np.asarray(rate / np.hypot(rate, SLIDING))


def _join_texts(texts: str | Sequence[str]) -> str:
    """Join the texts of all joints; one text if they are equal."""
    if isinstance(texts, str):
        return texts
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)


def _check_gain(name: str, array: FloatArray, needed: BoolArray, same: bool) -> FloatArray:
    """Return the gains as a read-only array; infinite for joints that do not use the gain."""
    if not same:
        array = np.array(np.broadcast_to(array, needed.shape))
    used = np.broadcast_to(needed, array.shape) if array.ndim else needed[0]
    if (np.isinf(array) & used).any():
        raise InvalidInput(
            f"servo gain {name} is missing. Specify one value for all joints or one per joint."
        )
    return checks.frozen_array(np.where(used, array, np.inf))


def _check_integrator(
    ki: FloatArray, second: BoolArray, interpolation: str, feed: npt.ArrayLike
) -> None:
    """Check that only second-order joints have an integrator, with a valid interpolation."""
    if not ki.any():
        return
    fits = ki.size == 1 or second.size in (1, ki.size)
    if fits and (ki * ~second).any():
        raise InvalidInput(
            "ki is the integral gain of the velocity loop, which only order second has. Specify 0 "
            "for joints of another order."
        )
    if interpolation == "cubic" and np.any(feed):
        raise InvalidInput(
            "acceleration_feedforward with ki is available only for linear set-points. Remove one "
            "of them, or use the interpolation linear."
        )
