"""Results of an identification: estimates, the servo that is written to a file, and predictions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np

from armcontour._version import __version__
from armcontour.control.identification.command_rates import fastest_motion
from armcontour.control.identification.estimate import UNITS, Estimate
from armcontour.control.identification.initial_state import fit_initial_state, predict
from armcontour.control.identification.log_segments import LogSegment, split_logs
from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, Frozen
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import shared_unit
from armcontour.core.render import Result, number
from armcontour.core.result import VERDICT, Data, Row, Table
from armcontour.core.source_file import writing_time
from armcontour.core.text import count_noun, list_some, short_repr, shorten
from armcontour.core.validity import AT_ENCODERS
from armcontour.motion.log import Log, arrange_joints, match_joints
from armcontour.motion.time_finding import TimeFinding, findings_table
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import LONGEST_SOURCE, TRUSTED
from armcontour.robot.servo.simulation import JointServo

# Explanation of the contour error ratio in the summary.
RATIO_NOTE = (
    f"of the error without compensation, {AT_ENCODERS}, on motion that was not fitted; trusted up "
    f"to {number(TRUSTED, '1')}"
)
# Maximum number of joints that a sentence names.
MAX_NAMES = 4
# Significant digits of the numbers in a servo file.
DIGITS = 6
# Factor for upper bounds in a servo file, so that they remain bounds when they are rounded.
ROUND_UP = 1 + 10.0 ** (1 - DIGITS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointIdentification(Result, Frozen):
    """The identified servo of one joint; its estimates are also attributes, such as `kp`.

    Args:
        name: Name of the joint.
        parameters: Estimates of the parameters by name.
        rms: RMS error of the model on the logs that were fitted [rad].
        rests: Residuals of each log: measured less predicted positions [rad], (n,); nan at samples
            that do not count. Empty if no model was fitted. Predictions are those from the other
            parts of the logs.
        program_rest: The same for a program that was recorded besides multisines [rad], (n,). Each
            part is predicted by a fit of its other parts and all other logs. Otherwise empty.
        order: Order of the servo that is written to the file: "second", "first" or "delay";
            "unknown" if none is written. `parameters` then are those of the rejected model.
        servo: Values that are written to the file.
        tracking_rms: RMS of command less measured position, about its mean [rad].
        largest: Largest error of `servo` on the logs that were fitted [rad].
        unseen_rms: RMS error on parts that were not fitted [rad]: with several logs in the worst
            log, with one log weighted by motion.
        share: `unseen_rms`, divided by the tracking error of the same log and weights.
        model_error: Largest error on all parts, fitted or not [rad].
        noise: Noise of the encoder, standard deviation [rad].
        note: Reason for a missing or weak model, or empty.
        effective: True if the residuals are not white. Then an effect is not modelled, and the
            parameters differ from the settings of the drive because they compensate for it.
        saturation: A sentence about samples at a limit of the drive, or empty.
        twin: A sentence about a second servo, with exchanged K_p and k_i, whose motion is nearly
            the same; or empty. The intervals include it.
        contour_ratio: RMS deviation from the contour with compensation divided by the deviation
            without compensation, in the worst log.
        offsets: Static deviation of the joint (or offset of its encoder) that was fitted with
            `servo` [rad], by index of the log.
        prismatic: True for a prismatic joint, with m instead of rad.
        moves: False if no log commands a motion of the joint.
    """

    name: str
    parameters: dict[str, Estimate] = field(default_factory=dict)
    rms: float = math.nan
    rests: tuple[FloatArray, ...] = ()
    program_rest: FloatArray = field(default_factory=lambda: np.zeros(0))
    order: str = "unknown"
    servo: JointServo = field(default_factory=lambda: JointServo(math.inf))
    tracking_rms: float = math.nan
    largest: float = math.nan
    unseen_rms: float = math.nan
    share: float = math.nan
    model_error: float = math.nan
    noise: float = math.nan
    note: str = ""
    effective: bool = False
    saturation: str = ""
    twin: str = ""
    contour_ratio: float = math.nan
    offsets: dict[int, float] = field(default_factory=dict)
    prismatic: bool = False
    moves: bool = True

    def __getattr__(self, name: str) -> Estimate:
        """Return the estimate of a parameter; its value is nan if the model has none."""
        if name not in UNITS:
            raise AttributeError(f"{type(self).__name__} has no {name}.")
        none = Estimate(name=name, unit=UNITS[name], value=math.nan, low=math.nan, high=math.nan)
        return self.parameters.get(name, none)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The estimates of all parameters."""
        return tuple(self.parameters.values())

    def to_data(self) -> Data:
        """Return the errors on parts that were not fitted, and the estimates, as data."""
        weak = "weak" if self.written and self.note else ""
        delay = "delay only" if not self.written and self.servo.dead_time else ""
        words = (weak, "effective" * self.effective, delay)
        notes = (self.saturation, self.twin, self.note)
        unit = shared_unit("rad", (self.prismatic,))
        return Data(
            f"Servo of {self.name}",
            (
                Row("name", self.name, "", "joint"),
                Row("share", self.share, "1", "tracking error left"),
                Row("contour_ratio", self.contour_ratio, "1", "contour error left"),
                Row("unseen_rms", self.unseen_rms, unit, "error, RMS"),
                Row("model_error", self.model_error, unit, "largest"),
                Row("order", self.order, "", "model", ", ".join(filter(None, words))),
                *(Row(x, getattr(self, x), unit) for x in ("tracking_rms", "rms", "largest")),
                *(Row(x, getattr(self, x)) for x in ("determined", "effective", "written")),
                *(Row(x, getattr(self, x)) for x in ("noise", "note", "saturation", "twin")),
            ),
            (Table.from_rows("parameters", [x.to_data().rows for x in self.estimates]),),
            notes=tuple(filter(None, notes)),
        )

    @property
    def written(self) -> bool:
        """True if the servo file has a model of this joint."""
        return self.order != "unknown"

    @property
    def determined(self) -> bool:
        """True if the logs determine all parameters of the model."""
        return bool(self.parameters) and all(x.determined for x in self.estimates)

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judgement:
    """Contour errors with and without compensation on motion that was not fitted.

    With compensation, the residuals of the model remain. A delay that all joints share causes no
    error. With an arm, errors are distances of its tool from the path. Without an arm, errors are
    distances in joint space, where each joint is weighted by the inverse of its tracking error.

    Args:
        programs: Number of different programs. If it is 1, parts of this program were predicted.
        ratios: RMS contour error with compensation divided by the error without compensation in
            each log, (logs,); 0 if only the noise of the encoders remains.
        program_ratio: The same in the worst of the logs that reverse about as slowly as the slowest
            log, such as programs in contrast to multisines. If this is one log among others, its
            parts are predicted by fits of its other parts and of the other logs.
        errors: RMS contour errors of each log without and with compensation, (logs, 2): in m with
            an arm, otherwise in multiples of the tracking errors.
    """

    programs: int
    ratios: FloatArray
    program_ratio: float
    errors: FloatArray

    @property
    def ratio(self) -> float:
        """Largest of `ratios`."""
        return float(self.ratios.max())

    @property
    def trusted(self) -> bool:
        """True if compensation removes at least half of the contour error."""
        return self.ratio <= TRUSTED


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification(Result, Frozen):
    """The identified servos of all joints.

    Args:
        logs: The logs, with repaired times.
        interpolation: Interpolation of set-points that was assumed.
        joints: The result of each joint.
        drive_cycle: Cycle of the drives [s], 0 for continuous loops.
        judgement: Contour errors with and without compensation on motion that was not fitted.
    """

    logs: tuple[Log, ...]
    interpolation: str
    joints: tuple[JointIdentification, ...] = field(repr=False)
    drive_cycle: float
    judgement: Judgement

    def __getitem__(self, name: str | int) -> JointIdentification:
        """Return the result of a joint by its name, or by its number from 1."""
        for j, joint in enumerate(self.joints):
            if name in (joint.name, j + 1):
                return joint
        names = ", ".join(x.name for x in self.joints)
        raise InvalidInput(f"{self.source} has no joint {name!r}. Its joints are {names}.")

    @property
    def source(self) -> str:
        """Sources of the logs (file names), separated by commas."""
        return ", ".join(dict.fromkeys(x.source for x in self.logs))

    def to_data(self) -> Data:
        """Return the verdict, then every joint and its parameters, as data."""
        result = self.judgement
        count = f"{sum(x.written for x in self.joints)} of {count_noun(len(self.joints), 'joint')}"
        doubt = "" if self.trusted else "not all joints have a good model"
        if self.moving_trusted and self.resting:
            doubt = f"only for the joints that move; {list_some(self.resting, MAX_NAMES)} rest"
        if not result.trusted:
            doubt = "compensation may be worse than none"
        sole = "provisional: judged on only one program; record a different program"
        return Data(
            f"Servo models of {count} from {self.source}",
            (
                Row("judgement.trusted", self.trusted, "", "trusted", doubt, VERDICT),
                Row(
                    "judgement.ratio", result.ratio, "1", "contour error left", RATIO_NOTE, VERDICT
                ),
                Row(
                    "judgement.programs", result.programs, "", "programs",
                    sole * (result.programs == 1), VERDICT,
                ),
                Row("judgement.ratios", result.ratios),
                Row("judgement.program_ratio", result.program_ratio, "1"),
                Row("judgement.errors", result.errors),
                Row("version", __version__),
                Row("logs", [x.source for x in self.logs]),
                Row("samples", sum(len(x.t) for x in self.logs)),
                Row("findings", findings_table(self.findings).as_dicts()),
                Row("interpolation", self.interpolation),
                Row("drive_cycle", self.drive_cycle, "s"),
                Row("determined", self.determined),
            ),
            self._tables(),
            notes=(*dict.fromkeys(x.note for x in self.joints if x.note), *self.remarks),
        )  # fmt: skip

    def _tables(self) -> tuple[Table, Table]:
        """Return two tables: one with all rows of each joint, one with its estimates only."""
        joint_data = [x.to_data() for x in self.joints]
        rows = [(*x.rows, Row("parameters", x.tables[0].as_dicts())) for x in joint_data]
        names = [x for x in UNITS if any(x in y.parameters for y in self.joints)]
        parameters = []
        for joint in self.joints:
            if joint.parameters:
                estimates = [getattr(joint, name).row for name in names]
                parameters.append((Row("joint", joint.name, "", "joint"), *estimates))
        return Table.from_rows("joints", rows), Table.from_rows("parameters", parameters)

    @property
    def trusted(self) -> bool:
        """True if all joints have a good model, and compensation halves the contour error."""
        return self.judgement.trusted and not any(x.note for x in self.joints)

    @property
    def resting(self) -> tuple[str, ...]:
        """Names of the joints that no log moves."""
        return tuple(x.name for x in self.joints if not x.moves)

    @property
    def moving_trusted(self) -> bool:
        """True if the result is trusted, but for joints that no log moves."""
        moving = [x for x in self.joints if x.moves]
        return self.judgement.trusted and bool(moving) and not any(x.note for x in moving)

    @property
    def determined(self) -> bool:
        """True if the logs determine all parameters of all joints."""
        return all(x.determined for x in self.joints)

    @property
    def findings(self) -> tuple[TimeFinding, ...]:
        """What was wrong with the times of the logs, and was repaired."""
        return tuple(chain.from_iterable(x.findings for x in self.logs))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about wrong times and saturation, and about effective parameters."""
        names = ", ".join(x.name for x in self.joints if x.effective and x.written)
        effective = (
            f"Effective parameters: {names}. The residuals are not white, so an effect is not "
            "modelled, and the parameters differ from the settings of the drive."
        )
        sentences = [x.sentence for x in self.findings]
        for joint in self.joints:
            sentences += filter(None, (joint.saturation, joint.twin))
        return (*sentences, effective) if names else tuple(sentences)

    __repr__ = short_repr

    @checked
    def servo_model(self, assumed: ServoModel | None = None) -> ServoModel:
        """Make the servo model for a servo file; joints without a model have the order "unknown".

        Args:
            assumed: Servo of the joints that no log moves; by default they have no model.

        Raises:
            InvalidInput: No joint has a model, or the assumed servo has other joints.
        """
        if not any(x.written for x in self.joints):
            notes = " ".join(x.note for x in self.joints[:2])
            raise InvalidInput(f"{self.source} determines the servo of no joint. {notes}")
        parameters: dict[str, Any] = {
            name: [getattr(x.servo, name) for x in self.joints] for name in JointServo._fields
        }
        fastest = fastest_motion(self.logs)
        offsets = [float(np.mean(list(x.offsets.values()) or [0.0])) for x in self.joints]
        largest = [x.model_error + abs(y) for x, y in zip(self.joints, offsets, strict=True)]
        orders = [x.order for x in self.joints]
        if assumed is not None:
            self._keep_assumed(assumed, parameters, orders)
        if not np.isfinite(parameters["kv"]).any():
            parameters["kv"] = None
        return ServoModel(
            interpolation=self.interpolation,
            order=tuple(orders),
            drive_cycle=self.drive_cycle,
            offset=[round_digits(x) for x in offsets],
            model_error=[round_digits(min(x * ROUND_UP, math.pi)) for x in largest],
            logged_velocity=[round_digits(x) for x in fastest.velocity],
            logged_acceleration=[round_digits(x) for x in fastest.acceleration],
            logged_frequency=[round_digits(x) for x in fastest.frequency],
            contour_ratio=float(f"{self.judgement.ratio:.3g}"),
            program_ratio=float(f"{self.judgement.program_ratio:.3g}"),
            programs=self.judgement.programs,
            source=self._servo_source(assumed is not None),
            **parameters,
        )

    def _servo_source(self, keeps_assumed: bool) -> str:
        """Write when and from which logs a servo was identified, and which joints are assumed."""
        logs = list_some(list(dict.fromkeys(x.source for x in self.logs)), MAX_NAMES)
        source = f"identified on {writing_time():%Y-%m-%d} from {logs}"
        if keeps_assumed and self.resting:
            source += f"; {list_some(self.resting, MAX_NAMES)} assumed"
        return shorten(source, LONGEST_SOURCE)

    def _keep_assumed(
        self, assumed: ServoModel, parameters: dict[str, list[float]], orders: list[str]
    ) -> None:
        """Write the assumed servo of the joints that no log moves.

        - `parameters`: list with a value per joint for each parameter of `JointServo`.
        - `orders`: the orders of the servos.
        """
        given = assumed.for_joints(len(self.joints))
        for j, joint in enumerate(self.joints):
            if joint.moves:
                continue
            orders[j] = given.order if isinstance(given.order, str) else given.order[j]
            for name, values in parameters.items():
                assumed_values = getattr(given, name)
                if assumed_values is not None:
                    values[j] = float(assumed_values[j])

    @checked
    def predict(self, log: Log) -> Prediction:
        """Simulate the servo for the servo file under the commands of a log.

        Args:
            log: A log of the same joints, also one that was not used for the identification.

        The constant offset between command and measurement, and the position and velocity at the
        start of the log, are fitted. Joints without a model follow their commands. Joints with the
        names of the identified ones are sorted in their order.

        Raises:
            InvalidInput: The log has other joints.
        """
        if log.dof != len(self.joints):
            raise InvalidInput(
                f"{log.source} has {log.dof} joints, but {self.source} has {len(self.joints)}. "
                "Specify a log of the same joints."
            )
        names = [x.name for x in self.joints]
        if match_joints(log.joint_names, names, log.source) is not None:
            log = arrange_joints(log, names)
        positions = log.command.copy()
        used = np.full(log.command.shape, False)
        for j, joint in enumerate(self.joints):
            delay = float(joint.servo.dead_time)
            for s in split_logs([log], j, self.interpolation, delay):
                rows = slice(s.start, s.start + len(s.y))
                positions[rows, j] = predict(s, joint.servo, joint.order, self.drive_cycle)
                used[rows, j] = s.use
        return Prediction(log=log, positions=positions, used=used)


def with_servo(
    joint: JointIdentification,
    segments: Sequence[LogSegment],
    servo: JointServo,
    order: str = "unknown",
    drive_cycle: float = 0.0,
    unseen: float = 0.0,
) -> JointIdentification:
    """Return the joint with its servo for the file, and with this servo's errors on the logs.

    - `unseen`: largest error on parts that were not fitted [rad].
    """
    rms = math.nan
    largest = math.pi
    offsets = {}
    if segments:
        fits = [fit_initial_state(s, servo, order, drive_cycle) for s in segments]
        pairs = list(zip(segments, fits, strict=True))
        offsets = {s.log: x.offset for s, x in pairs}
        errors = np.concatenate([(s.y - x.positions)[s.use] for s, x in pairs])
        rms = float(np.sqrt(np.mean(errors**2)))
        largest = float(np.abs(errors).max())
    written = replace(joint, order=order, servo=servo, rms=rms, largest=largest, offsets=offsets)
    return replace(written, model_error=max(unseen, largest))


def round_digits(value: float) -> float:
    """Return a value with the digits of a servo file."""
    return float(f"{value:.{DIGITS}g}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction(Result):
    """Motion of an identified servo under the commands of a log.

    Args:
        log: The log.
        positions: Predicted positions [rad], (n, dof).
        used: Mask of the samples that count, (n, dof). The first 40 ms, or the dead time if it is
            longer, do not count, because they depend on commands before the log.
    """

    log: Log = field(repr=False)
    positions: FloatArray = field(repr=False)
    used: BoolArray = field(repr=False)

    @property
    def errors(self) -> FloatArray:
        """Measured less predicted positions [rad], (n, dof); 0 at samples outside `used`."""
        return np.where(self.used, self.log.measured - self.positions, 0.0)

    @property
    def rms(self) -> FloatArray:
        """RMS error of each joint [rad], (dof,)."""
        return _rms(self.errors, self.used)

    @property
    def largest(self) -> FloatArray:
        """Largest error of each joint [rad], (dof,)."""
        return np.asarray(np.abs(self.errors).max(axis=0))

    @property
    def tracking_rms(self) -> FloatArray:
        """RMS of measured less commanded positions, without the mean difference [rad], (dof,)."""
        errors = self.log.measured - self.log.command
        count = np.maximum(self.used.sum(axis=0), 1)
        return _rms(errors - np.sum(errors * self.used, axis=0) / count, self.used)

    def tool_errors(self, arm: Arm) -> FloatArray:
        """Return distances between the tool at measured and at predicted positions [m], (n,).

        The distance is 0 at a sample that does not count for some joint.

        Raises:
            InvalidInput: The arm has another number of joints.
        """
        checks.check_type("arm", arm, Arm)
        if arm.dof != self.log.dof:
            raise ArmMismatch(
                f"{self.log.source} has {self.log.dof} joints, but the arm {arm.name} has "
                f"{arm.dof}. Specify the arm with which the log was recorded."
            )
        offsets = arm.tool_position(self.log.measured) - arm.tool_position(self.positions)
        return np.where(self.used.all(axis=1), np.linalg.norm(offsets, axis=1), 0.0)

    def to_data(self, arm: Arm | None = None) -> Data:
        """Return the errors of all joints as data; the summary shows the largest error."""
        unit = shared_unit("rad", self.log.prismatic)

        def of_joints(name: str, label: str) -> Row:
            values = getattr(self, name)
            return Row(name, values, unit, label, self.log.joint_names[int(values.argmax())])

        rows = [
            Row("log", self.log.source),
            of_joints("tracking_rms", "tracking error, RMS"),
            of_joints("rms", "predicted to, RMS"),
            of_joints("largest", "predicted to, largest"),
        ]
        if arm is not None:
            errors = self.tool_errors(arm)
            rms = float(np.sqrt(np.mean(errors**2)))
            rows.append(Row("tool.rms", rms, "m", "at the tool, RMS"))
            rows.append(Row("tool.largest", float(errors.max()), "m", "at the tool, largest"))
        return Data(f"Prediction of {self.log.source}", tuple(rows))

    __repr__ = short_repr


def _rms(values: FloatArray, used: BoolArray) -> FloatArray:
    """Return the root mean square over the samples in `used`, (dof,)."""
    count = np.maximum(used.sum(axis=0), 1)
    return np.asarray(np.sqrt(np.sum(np.where(used, values, 0.0) ** 2, axis=0) / count))
