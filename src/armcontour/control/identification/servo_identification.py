"""Identification of independent servos from logs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np

from armcontour.control.identification.candidate_models import Search
from armcontour.control.identification.command_rates import fastest_motion
from armcontour.control.identification.contour_judgement import choose_and_judge
from armcontour.control.identification.identification_result import Identification
from armcontour.control.identification.joint_identification import identify_joint
from armcontour.core import checks
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import Options, checked, declared
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import Choice, Interval, Quantity
from armcontour.core.text import show
from armcontour.motion.log import (
    INTERPOLATIONS,
    Log,
    arrange_joints,
    with_units_of,
)
from armcontour.motion.log_checks import check_interval, check_range_of_log, check_speeds
from armcontour.motion.log_times import repair_times
from armcontour.robot import Arm

# Orders of the candidate models for each value of the option `model`.
MODELS = {"auto": ("delay", "first", "second"), "second": ("second",), "first": ("first",)}


@declared(eq=False)
class ServoFit(Options):
    """Options of `identify` for independent joint servos.

    >>> ac.ServoFit(model="first", longest_dead_time=0.05).model
    'first'

    Args:
        interpolation: Interpolation of set-points in the controller, "linear" or "step"; by default
            as stated in the log, otherwise linear.
        longest_dead_time: Longest dead time of the search [s].
        model: "second" or "first" allows only models of this order, "auto" allows all models.
        drive_cycle: Time between two computations of the drives' loops, from 0.25 to 8 ms [s]; by
            default the loops are continuous.
        kinematics: The arm whose tool is used for the contour error; by default the contour error
            is computed in joint space.
    """

    method: ClassVar[str] = "servo"
    interpolation: Annotated[str, Choice(INTERPOLATIONS)] | None = None
    longest_dead_time: Interval = 0.25
    model: Annotated[str, Choice(tuple(MODELS))] = "auto"
    drive_cycle: Annotated[float, Quantity("s", "1 ms", within=(2.5e-4, 8e-3))] | None = None
    kinematics: Arm | None = None


def choose_interpolation(logs: Sequence[Log], required: str | None) -> str:
    """Return the required interpolation of set-points, otherwise that of the logs, or "linear"."""
    for log in logs:
        checks.raise_if(
            required is not None and log.interpolation not in (None, required),
            f"{log.source} states the interpolation {log.interpolation}, but the option "
            f"interpolation is {required}. Remove one of the two.",
        )
    kinds = {required or x.interpolation or "linear" for x in logs}
    if len(kinds) > 1:
        raise InvalidInput(
            "All logs must have the same interpolation of set-points, but they state different "
            "ones. Identify each log separately."
        )
    return kinds.pop()


SERVO_FIT = ServoFit()


@checked
def identify(
    logs: Log | Sequence[Log], options: ServoFit = SERVO_FIT, *, progress: Progress | None = None
) -> Identification:
    """Identify the servo of every joint from logs.

    The candidate models of a joint are a dead time and servos of first and second order, as in
    `ServoModel`. The simplest model that predicts parts of the logs to which it was
    not fitted is selected. The model is simulated exactly from the set-points. With several logs,
    each log is predicted from the others. A model is good if its error is at most 30 % of the
    tracking error, or at most 3 times the noise of the encoder. A model with an error of at most
    80 % is weak. For joints without a good model, the weak model, the delay of the joint or nothing
    is written, whichever has the smallest contour error on motion that was not fitted.

    >>> identification = ac.identify(ac.read_log("log.csv"))
    >>> identification.determined, identification.joints[0].order
    (True, 'delay')

    Args:
        logs: A log, with set-points and measured positions, or several logs of the same robot.
        options: Options, such as `ServoFit(model="second")`.
        progress: Called with a step that names the joint, before each joint is identified.

    Raises:
        InvalidInput: The sample interval of a log is outside 0.05 to 100 ms, the times of a log
            are wrong and measured velocities do not determine the true ones, the logs or the arm
            differ in their joints, or command and measurement of a log do not belong together.
    """
    originals = checks.check_sequence("logs", _as_sequence(logs), Log, "Logs")
    checks.raise_if(
        not originals, "The identification requires at least one log, but logs is empty."
    )
    arm = options.kinematics
    regular_logs = _prepare(originals, arm)
    _check_same_joints(regular_logs)
    interpolation = choose_interpolation(regular_logs, options.interpolation)
    for log in regular_logs:
        _check_positions(log, arm)
    search = Search(
        _longest_dead_time(regular_logs, options.longest_dead_time),
        options.drive_cycle or 0.0,
        MODELS[options.model],
    )
    program = _find_sole_program(regular_logs)
    report = subprogress(progress)
    joints = []
    for j, name in enumerate(regular_logs[0].joint_names):
        report(Step((name,), j / regular_logs[0].dof))
        joints.append(identify_joint(regular_logs, j, interpolation, search, program))
    judged, judgement = choose_and_judge(
        regular_logs, joints, interpolation, search.longest, arm, program
    )
    return Identification(
        logs=regular_logs,
        interpolation=interpolation,
        joints=judged,
        drive_cycle=search.drive_cycle,
        judgement=judgement,
    )


def _as_sequence(logs: Log | Sequence[Log]) -> Sequence[Log]:
    """Return the logs as a sequence, also if there is only one."""
    return (logs,) if isinstance(logs, Log) else logs


def _prepare(originals: Sequence[Log], arm: Arm | None) -> tuple[Log, ...]:
    """Check the sample intervals of logs, and repair their times."""
    for log in originals:
        check_interval(log.source, log.t)
    if arm is not None:
        originals = [_with_joints_of(x, arm) for x in originals]
    return tuple(repair_times(x) for x in originals)


def _check_same_joints(logs: Sequence[Log]) -> None:
    """Check that all logs have the same joint names."""
    first = logs[0]
    for log in logs[1:]:
        if log.joint_names != first.joint_names:
            raise InvalidInput(
                f"All logs must have the same joints, but joint_names is "
                f"{show(str(first.joint_names))} in {first.source} and "
                f"{show(str(log.joint_names))} in {log.source}."
            )


def _check_positions(log: Log, arm: Arm | None) -> None:
    """Check that positions are within the ranges of an arm, and that speeds are plausible."""
    if arm is not None:
        positions = {"set-point": log.command, "measured position": log.measured}
        check_range_of_log(log.source, log.t, positions, log.joint_names, arm)
    check_speeds(log.source, log.t, log.measured, log.joint_names, log.prismatic)


def _longest_dead_time(logs: Sequence[Log], required: float) -> float:
    """Return the longest dead time of the search [s], which is short compared with the logs."""
    shortest = min(float(x.t[-1] - x.t[0]) for x in logs)
    return min(required, shortest / 4)


def _find_sole_program(logs: Sequence[Log]) -> int | None:
    """Return the index of the only program if the other logs are multisines; otherwise None."""
    slow = np.flatnonzero(fastest_motion(logs).slow_logs)
    return int(slow[0]) if len(slow) == 1 < len(logs) else None


def _with_joints_of(log: Log, arm: Arm) -> Log:
    """Return the log with the joints of an arm in their order, and with their units."""
    if log.dof < arm.dof:
        raise ArmMismatch(
            f"{log.source} has {log.dof} joints, but the arm {arm.name} has {arm.dof}. Specify the "
            "arm with which the log was recorded."
        )
    return with_units_of(arrange_joints(log, arm.joint_names), arm)
