"""`RobotIdentification`: the identified parameters of an arm with masses and of its drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from armcontour._checks import FloatArray
from armcontour._describing import brief
from armcontour._version import __version__
from armcontour.arms import Arm
from armcontour.core.fields import Checked, checked
from armcontour.core.render import Result, number
from armcontour.core.result import VERDICT, Data, Row, Table
from armcontour.errors import InvalidInput
from armcontour.identification.results import Estimate, estimate_table
from armcontour.motion import Log
from armcontour.servo import ServoModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotJoint(Result):
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

    def to_data(self) -> Data:
        """The residuals and the estimates."""
        return Data(
            self.name,
            (
                Row("name", self.name, "", "joint"),
                Row("rms", self.rms, "rad", "residual, RMS"),
                Row("explained", self.explained, "1", "explained"),
            ),
            (estimate_table("parameters", self.estimates),),
        )


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
class RobotIdentification(Result):
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

    @checked
    def to_data(self, files: Sequence[str] = ()) -> Data:
        """Whether all parameters are determined, those of the robot, then every joint.

        Args:
            files: The files of the result, relative to its folder.
        """
        joints = [x.to_data() for x in self.joints]
        rows = [(*x.rows, Row("parameters", x.tables[0].as_dicts())) for x in joints]
        parameters = [
            (x.rows[0], *(y.row for y in z.estimates))
            for x, z in zip(joints, self.joints, strict=True)
        ]
        nominal = f"nominal: {', '.join(self.open)}" if self.open else ""
        return Data(
            f"{self.nominal.name}, identified from {self.source}",
            (
                Row("determined", self.determined, "", "all determined", nominal, VERDICT),
                Row("not_determined", self.open),
                Row("gravity_feedforward", self.gravity, "", "gravity compensation"),
                Row("version", __version__),
                Row("logs", [x.log.source for x in self.fitted]),
                Row("samples", sum(len(x.t) for x in self.fitted)),
                Row("arm", self.nominal.name),
                Row("interpolation", self.interpolation, "", "set-points"),
                Row("notes", self.notes),
                *([Row("files", list(files))] if files else []),
            ),
            (
                estimate_table("robot", self.common),
                Table.of_rows("joints", rows),
                Table.of_rows("parameters", parameters),
            ),
            notes=self.notes,
        )

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
                f"{self.source}: the dead time is {number(self.dead_time.value, 's')}, below zero: "
                "commands are logged late, or set-points that were taken for interpolated are held "
                "(interpolation step)."
            )
        return self.gains
