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

    The parameters are the gains `kp` and `kv` [1/s] and the friction `viscous` [N m s/rad] and
    `coulomb` [N m]. If the nominal drive inertias are zero, the parameter `armature` is added: the
    inertia of the drive, reflected to the joint [kg m²].

    Args:
        explained: Share of the mean square of the tracking error (command less measured position)
            that the model explains.
    """

    explained: float

    def to_data(self) -> Data:
        """Data of the residuals and of the estimates."""
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

    The parameters of the whole robot are `payload_mass` [kg], `payload_center` in the frame of the
    tip [m] and `dead_time` [s], and `armature`, a common factor of the nominal drive inertias
    unless these are zero. A parameter that the logs do not determine has its nominal value in
    `arm` and `servo_model()`.

    Args:
        nominal: The nominal arm.
        gravity: Gravity feed-forward of the controller: "loaded", "nominal" or "none".
        arm: The identified arm, with payload, friction and inertias of the drives.
        notes: Remarks on the result, as sentences.
        gains: The servo for `arm`. Gains that are neither determined nor nominal are guesses.
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
        """Data of the verdict (all parameters determined), of the robot, and of every joint."""
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
        """Estimates of the payload's centre of mass in the frame of the tip [m]: x, y and z."""
        return tuple(self.parameters[x] for x in CENTER)

    @property
    def open(self) -> tuple[str, ...]:
        """Names of the parameters that the logs do not determine, such as "coulomb of joint 2"."""
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
        """True if the logs determine all parameters, except those that no log can determine."""
        return not self.open

    def servo_model(self) -> ServoModel:
        """The identified servo, with the inertia J to which its gains refer.

        Raises:
            InvalidInput: A gain is not determined and has no nominal value, or the dead time is
                negative.
        """
        for joint in self.joints:
            for gain in (joint.kp, joint.kv):
                if not gain.determined and not self.gains_known:
                    raise InvalidInput(
                        f"{self.source} does not determine {gain.name} of {joint.name}, and no "
                        "nominal servo is given whose value could be used. Specify servo=."
                    )
        if self.dead_time.high < 0:
            raise InvalidInput(
                f"{self.source}: the dead time must not be negative, but is "
                f"{number(self.dead_time.value, 's')}. Either commands are logged with a delay, or "
                "the controller holds set-points: use the interpolation step."
            )
        return self.gains
