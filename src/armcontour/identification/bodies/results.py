"""`RobotIdentification`: the identified parameters of an arm with masses and of its drives."""

from __future__ import annotations

from dataclasses import dataclass, field

from armcontour._checks import FloatArray
from armcontour._describing import brief, line_up
from armcontour.arms import Arm
from armcontour.core.fields import Checked
from armcontour.errors import InvalidInput
from armcontour.identification.results import Estimate
from armcontour.motion import Log
from armcontour.servo import ServoModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotJoint:
    """The identified parameters of one joint.

    Args:
        name: Name of the joint.
        kp: Gain of the position loop [1/s].
        kv: Gain of the velocity loop [1/s].
        viscous: Viscous friction [N m s/rad].
        coulomb: Coulomb friction [N m].
        armature: Inertia of the drive, reflected to the joint [kg m²]; None if one factor of all
            nominal drive inertias was sought.
        rms: Root mean square of the residuals [rad].
        explained: Share of the mean square of command less measured position that the model
            explains.
    """

    name: str
    kp: Estimate
    kv: Estimate
    viscous: Estimate
    coulomb: Estimate
    armature: Estimate | None
    rms: float
    explained: float

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The estimates of all parameters."""
        own = () if self.armature is None else (self.armature,)
        return (self.kp, self.kv, self.viscous, self.coulomb, *own)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitted(Checked):
    """The part of a log that was compared with the simulated motion.

    Args:
        log: The log.
        t: Times [s], (n,).
        measured: Measured positions [rad], (n, dof).
        simulated: Positions of the model [rad], (n, dof).
    """

    log: Log
    t: FloatArray
    measured: FloatArray
    simulated: FloatArray

    @property
    def residuals(self) -> FloatArray:
        """Measured less simulated positions [rad], (n, dof)."""
        return self.measured - self.simulated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotIdentification:
    """The identified parameters of an arm with masses and of its drives.

    A parameter that the logs do not determine keeps its nominal value in `arm` and `servo`.

    Args:
        nominal: The nominal arm.
        gravity: What the controller adds against gravity: "loaded", "nominal" or "none".
        interpolation: Interpolation of set-points that was assumed.
        joints: The result of each joint.
        payload_mass: Mass of the payload [kg].
        payload_center: Centre of mass of the payload in the frame of the tip [m], along x, y and z.
        armature: Factor of the nominal inertias of the drives; None if these are zero, and those
            of every joint are sought.
        dead_time: Dead time of all joints [s].
        arm: The identified arm, with payload, friction and inertias of the drives.
        fitted: The logs, with the motion of the model.
        notes: Findings, as sentences.
        gains: The servo that goes with `arm`; a guess where gains are not determined or known.
        gains_known: Whether a nominal servo was given.
    """

    nominal: Arm
    gravity: str
    interpolation: str
    joints: tuple[RobotJoint, ...] = field(repr=False)
    payload_mass: Estimate
    payload_center: tuple[Estimate, Estimate, Estimate]
    armature: Estimate | None
    dead_time: Estimate
    arm: Arm
    fitted: tuple[Fitted, ...] = field(repr=False)
    notes: tuple[str, ...] = ()
    gains: ServoModel = field(repr=False)
    gains_known: bool

    def __str__(self) -> str:
        """A row for the load, the dead time, the drive inertias and each joint."""
        load = [self.payload_mass.words, *(f"{x.words}" for x in self.payload_center)]
        common = [
            ("payload", f"{load[0]}, at ({', '.join(load[1:])})"),
            ("dead time", self.dead_time.words),
            (
                "drive inertias",
                "" if self.armature is None else f"{self.armature.words} of nominal",
            ),
        ]
        joints = [
            (x.name, ", ".join(f"{y.name} {y.words}" for y in x.estimates)) for x in self.joints
        ]
        return line_up(f"{self.nominal.name}, identified from {self.source}", [*common, *joints])

    __repr__ = brief

    @property
    def source(self) -> str:
        """Sources of the logs."""
        return ", ".join(dict.fromkeys(x.log.source for x in self.fitted))

    @property
    def common(self) -> tuple[Estimate, ...]:
        """The estimates of the parameters of the whole robot."""
        scale = () if self.armature is None else (self.armature,)
        return (self.payload_mass, *self.payload_center, *scale, self.dead_time)

    @property
    def open(self) -> tuple[str, ...]:
        """Parameters that the logs do not determine, such as "coulomb of joint 2"."""
        tied = "kv" if self.gains_known else "viscous"
        massless = self.payload_mass.determined and self.payload_mass.low <= 0
        joints = [(f"{x.name} of {y.name}", x) for y in self.joints for x in y.estimates]
        common = [(x.name, x) for x in self.common]
        return tuple(
            name
            for name, x in [*joints, *common]
            if not x.determined
            and x.name != tied
            and not (massless and x.name.startswith("payload_center"))
        )

    @property
    def determined(self) -> bool:
        """Whether the logs determine every parameter that logs can determine."""
        return not self.open

    @property
    def servo(self) -> ServoModel:
        """The identified servo, with the inertia J that its gains belong to.

        Raises:
            InvalidInput: A gain is not determined and has no nominal value, or the dead time is
                below zero.
        """
        for joint in self.joints:
            for x in (joint.kp, joint.kv):
                if not x.determined and not self.gains_known:
                    raise InvalidInput(
                        f"{self.source} does not determine {x.name} of {joint.name}, and there is "
                        "no nominal servo whose value it could keep: give servo=."
                    )
        if self.dead_time.high < 0:
            raise InvalidInput(
                f"{self.source}: the dead time is {self.dead_time.value * 1e3:.3g} ms, below zero: "
                "commands are logged late, or set-points that were taken for interpolated are held "
                "(interpolation step)."
            )
        return self.gains
