"""Result of the identification of an arm with masses and of its drives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armcontour._version import __version__
from armcontour.control.identification.bodies.body_model import CENTER
from armcontour.control.identification.estimates import Estimate, IdentifiedJoints, JointEstimates
from armcontour.core.errors import InvalidInput
from armcontour.core.render import number
from armcontour.core.result import VERDICT, Data, Row
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyJoint(JointEstimates):
    """The identified parameters of one joint.

    They are the gains `kp` and `kv` [1/s], the friction `viscous` [N m s/rad] and `coulomb` [N m],
    and, if the nominal drive inertias are zero, the inertia of the drive `armature`, reflected to
    the joint [kg m²].

    Args:
        explained: Share of the mean square of command less measured position that the model
            explains.
    """

    explained: float

    def to_data(self) -> Data:
        """The residuals and the estimates."""
        return Data(
            self.name,
            (
                Row("name", self.name, "", "joint"),
                Row("rms", self.rms, "rad", "residual, RMS"),
                Row("explained", self.explained, "1", "explained"),
            ),
            (self.table("parameters"),),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyIdentification(IdentifiedJoints):
    """The identified parameters of an arm with masses and of its drives.

    Those of the whole robot are `payload_mass` [kg], `payload_center` in the frame of the tip [m],
    `armature`, a factor of the nominal drive inertias unless these are zero, and `dead_time` [s]. A
    parameter that the logs do not determine keeps its nominal value in `arm` and `servo_model()`.

    Args:
        nominal: The nominal arm.
        gravity: Gravity feed-forward of the controller: "loaded", "nominal" or "none".
        arm: The identified arm, with payload, friction and inertias of the drives.
        notes: Findings, as sentences.
        gains: The servo for `arm`; a guess for gains that are neither determined nor nominal.
        gains_known: True if a nominal servo was given.
    """

    joints: tuple[BodyJoint, ...] = field(repr=False)
    nominal: Arm
    gravity: str
    arm: Arm
    notes: tuple[str, ...] = ()
    gains: ServoModel = field(repr=False)
    gains_known: bool

    def to_data(self) -> Data:
        """Verdict (all parameters determined), parameters of the robot, then every joint."""
        nominal = f"nominal: {', '.join(self.open)}" if self.open else ""
        samples = sum(int(np.sum(np.isfinite(x))) for x in self.joints[0].rests)
        return Data(
            f"{self.nominal.name}, identified from {self.source}",
            (
                Row("determined", self.determined, "", "all determined", nominal, VERDICT),
                Row("not_determined", self.open),
                Row("gravity_feedforward", self.gravity, "", "gravity compensation"),
                Row("version", __version__),
                Row("logs", [x.source for x in self.logs]),
                Row("samples", samples),
                Row("arm", self.nominal.name),
                Row("interpolation", self.interpolation, "", "set-points"),
                Row("notes", self.notes),
            ),
            (self.table("robot"), *self._tables()),
            notes=self.notes,
        )

    @property
    def payload_center(self) -> tuple[Estimate, ...]:
        """Centre of mass of the payload in the frame of the tip [m], along x, y and z."""
        return tuple(self.parameters[x] for x in CENTER)

    @property
    def open(self) -> tuple[str, ...]:
        """Parameters that the logs do not determine, such as "coulomb of joint 2"."""
        tied = "kv" if self.gains_known else "viscous"
        massless = self.payload_mass.determined and self.payload_mass.low <= 0
        joints = [(f"{x.name} of {y.name}", x) for y in self.joints for x in y.estimates]
        common = [(x.name, x) for x in self.estimates]
        return tuple(
            name
            for name, x in [*joints, *common]
            if not x.determined
            and x.name != tied
            and not (massless and x.name.startswith("payload_center"))
        )

    @property
    def determined(self) -> bool:
        """True if the logs determine every parameter that logs can determine."""
        return not self.open

    def servo_model(self) -> ServoModel:
        """The identified servo, with the inertia J that its gains belong to.

        Raises:
            InvalidInput: A gain is not determined and has no nominal value, or the dead time is
                below zero.
        """
        for joint in self.joints:
            for gain in (joint.kp, joint.kv):
                if not gain.determined and not self.gains_known:
                    raise InvalidInput(
                        f"{self.source} does not determine {gain.name} of {joint.name}, and there "
                        "is no nominal servo whose value it could keep: give servo=."
                    )
        if self.dead_time.high < 0:
            raise InvalidInput(
                f"{self.source}: the dead time is {number(self.dead_time.value, 's')}, below zero: "
                "commands are logged with a delay, or set-points are held instead of interpolated "
                "(interpolation step)."
            )
        return self.gains
