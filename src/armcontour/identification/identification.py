"""Entry point `identify`: the servo of every joint, or a robot with masses, from logs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, overload

from armcontour import _checks
from armcontour._progress import Progress, Step, under
from armcontour._quantities import Choice, Interval
from armcontour.arms import Arm
from armcontour.core.fields import checked
from armcontour.errors import InvalidInput
from armcontour.identification.bodies import GRAVITIES, RobotIdentification, identify_robot
from armcontour.identification.fitting import Search, noise_of
from armcontour.identification.joint import changes_velocity, identify_joint
from armcontour.identification.judgement import judge
from armcontour.identification.results import Identification
from armcontour.motion.log import INTERPOLATIONS, Log, join
from armcontour.motion.log_checks import arrange, refuse_fast
from armcontour.servo import ServoModel

# Orders of the models that may be selected, by the option model.
MODELS = {"auto": ("delay", "first", "second"), "second": ("second",), "first": ("first",)}
# Longest dead time of the search [s], and of robots with masses the smallest one.
LONGEST_DELAY = 0.25
BELOW_ZERO = 10e-3
# Sample intervals [s] from which a servo can be identified. No robot controller samples faster than
# 20 kHz. Below 10 Hz the response to the gains happens between two samples.
INTERVALS = (5e-5, 0.1)
# Cycle time of the drives [s] that is assumed with an arm: 4 kHz is usual. The longest one, half of
# which is small against the time constant of a velocity loop.
DRIVE_CYCLE, LONGEST_CYCLE = 2.5e-4, 2e-3
# Cycles of the drives' loops that are modelled without an arm [s].
CYCLES = (2.5e-4, 8e-3)


@overload
def identify(
    log: Log | Sequence[Log],
    *,
    arm: None = None,
    drive_cycle: float | None = None,
    model: str = "auto",
    kinematics: Arm | None = None,
    interpolation: str | None = None,
    longest_dead_time: float = LONGEST_DELAY,
    progress: Progress | None = None,
) -> Identification: ...


@overload
def identify(
    log: Log | Sequence[Log],
    *,
    arm: Arm,
    servo: ServoModel | None = None,
    gravity: str | None = None,
    drive_cycle: float | None = None,
    interpolation: str | None = None,
    longest_dead_time: float = LONGEST_DELAY,
    progress: Progress | None = None,
) -> RobotIdentification: ...


@checked
def identify(
    log: Log | Sequence[Log],
    *,
    arm: Arm | None = None,
    servo: ServoModel | None = None,
    gravity: Annotated[str, Choice(GRAVITIES)] | None = None,
    drive_cycle: float | None = None,
    model: Annotated[str, Choice(tuple(MODELS))] = "auto",
    kinematics: Arm | None = None,
    interpolation: Annotated[str, Choice(INTERPOLATIONS)] | None = None,
    longest_dead_time: Interval = LONGEST_DELAY,
    progress: Progress | None = None,
) -> Identification | RobotIdentification:
    """Identify a servo from a log, or with an arm its payload, friction and drives from logs.

    Without an arm, the model of each joint is the simplest one of a dead time, a servo of first and
    one of second order, as in `ServoModel`, that predicts parts of the logs to which it was not
    fitted. The model is simulated exactly from the set-points. With several logs, each one is
    predicted from the others. A model is good if the error is at most 30 % of the tracking error,
    or 3 times the noise of the encoder. A weak model, with at most 80 %, is written if that reduces
    the contour error where it was not fitted; otherwise the delay of the joint is, or nothing.

    With an arm that has masses, the model is its rigid bodies, moved by drives with the torques
    `J K_v (K_p (u(t - dead time) - q) - dq)` and gravity feed-forward, with viscous and Coulomb
    friction and a payload. What the logs do not tell keeps its nominal value.

    Args:
        log: The log, with set-points and measured positions, or several logs of the same robot.
        arm: The nominal arm, with masses; it gives what is nominal of payload, friction and drive
            inertias.
        servo: With an arm: the nominal servo, of order "second". Its K_v is kept, since a log shows
            only the sum of J K_v and viscous friction; without it friction is kept, and K_v sought.
        gravity: With an arm: what the controller adds against gravity, the torque of the "nominal"
            arm, of the arm with its load as it is ("loaded"), or "none"; by default what the logs
            speak for.
        drive_cycle: Time between two computations of the drives' loops [s]. Without an arm from
            0.25 to 8 ms; by default the loops are continuous. With an arm the time for which the
            drives keep their torque; by default 0.25 ms.
        model: Without an arm: "second" or "first" for models of this order only, or "auto".
        kinematics: Without an arm: the arm at whose tool the contour error is computed; by default
            it is computed in joint space.
        interpolation: Interpolation of set-points in the controller, "linear" or "step"; by default
            that of the log, else linear.
        longest_dead_time: Largest dead time of the search [s].
        progress: Called with a step, the name of a joint or of a stage, before each.

    Raises:
        InvalidInput: An unknown option, samples too far apart, a log in which command and
            measurement cannot belong together, or logs that are not of the arm.
    """
    longest = longest_dead_time
    logs = _checks.listed("log", (log,) if isinstance(log, Log) else log, Log, "Logs")
    if arm is None:
        for name, value in (("servo", servo), ("gravity", gravity)):
            if value is not None:
                raise InvalidInput(f"{name} goes with an arm with masses: give arm= too.")
        kind, cycle = _choose_interpolation(join(logs), interpolation), 0.0
        if drive_cycle is not None:
            cycle = _checks.between("cycle of the drives", drive_cycle, *CYCLES, "s")
        return _identify_servo(logs, MODELS[model], kind, longest, cycle, kinematics, progress)
    for name, given in (("model", model != "auto"), ("kinematics", kinematics is not None)):
        joints = f"{name} is for joints without an arm: leave it out, or leave arm out."
        _checks.refuse_if(given, joints)
    _checks.refuse_if(not logs, "There is no log to identify from: give at least one.")
    for x in logs:
        x.refuse_gaps()
    every = [arrange(x, arm.joint_names) for x in logs]
    cycle = DRIVE_CYCLE
    if drive_cycle is not None:
        cycle = _checks.between("cycle of the drives", drive_cycle, 0.0, LONGEST_CYCLE, "s")
    kinds = {_choose_interpolation(x, interpolation) for x in every}
    differ = "The logs are of different interpolation: identify them one by one."
    _checks.refuse_if(len(kinds) > 1, differ)
    for x in every:
        _refuse_interval(x)
    delays = _delays(min(every, key=lambda x: x.t[-1] - x.t[0]), longest)
    try:
        return identify_robot(every, arm, servo, gravity, kinds.pop(), delays, cycle, progress)
    except InvalidInput:
        changes = (
            changes_velocity(x.t - x.t[0], y) for x in every for y in (*x.command.T, *x.measured.T)
        )
        if any(changes):
            raise
        names = ", ".join(dict.fromkeys(x.source for x in every))
        raise InvalidInput(
            f"Every joint in {names} stands or moves at a uniform velocity, which tells no gains, "
            "dead time or inertias: record a motion whose velocity changes, such as a multisine "
            "around the bandwidth of the position loops."
        ) from None


def _identify_servo(
    logs: tuple[Log, ...],
    orders: tuple[str, ...],
    interpolation: str,
    longest: float,
    cycle: float,
    kinematics: Arm | None,
    progress: Progress | None,
) -> Identification:
    """Identify the servo of every joint of some logs."""
    for x in logs:
        _refuse_interval(x)
        refuse_fast(x, [noise_of(y) for y in x.measured.T])
    search = Search(min(_delays(x, longest)[1] for x in logs), cycle)
    tell, joints = under(progress), []
    for j, name in enumerate(logs[0].joint_names):
        tell(Step((name,)))
        joints.append(identify_joint(logs, j, orders, interpolation, search))
    if kinematics is not None and kinematics.dof != len(joints):
        raise InvalidInput(
            f"{logs[0].source} has {len(joints)} joints, but the arm {kinematics.name} has "
            f"{kinematics.dof}: give the arm of the log."
        )
    every, judgement = judge(logs, joints, interpolation, search.longest, kinematics)
    return Identification(
        logs=logs, interpolation=interpolation, cycle=cycle, joints=every, judgement=judgement
    )


def _delays(log: Log, longest: float) -> tuple[float, float]:
    """Smallest and largest dead time of the search [s]."""
    duration = float(log.t[-1] - log.t[0])
    return -min(BELOW_ZERO, duration / 50), min(longest, duration / 4)


def _choose_interpolation(log: Log, interpolation: str | None) -> str:
    """Choose the interpolation of set-points: as given, else that of the log, else linear.

    Raises:
        InvalidInput: An unknown interpolation, or another one than in the log.
    """
    if interpolation is not None:
        _checks.refuse_if(
            log.interpolation not in (None, interpolation),
            f"{log.source} says that its interpolation is {log.interpolation}, but "
            f"{interpolation} is required: leave one of them out.",
        )
    return interpolation or log.interpolation or "linear"


def _refuse_interval(log: Log) -> None:
    """Refuse a log with a sample interval outside INTERVALS.

    Raises:
        InvalidInput: The interval is too short or too long.
    """
    low, high = INTERVALS
    # Times are rounded.
    if not low * (1 - 1e-6) <= log.interval <= high * (1 + 1e-6):
        raise InvalidInput(
            f"{log.source} has a sample every {log.interval:.3g} s and lasts "
            f"{log.t[-1] - log.t[0]:.3g} s, but logs of robots have one every {low:g} s to "
            f"{high:g} s: give the column of times its unit, such as t [s], or record at another "
            "rate.",
            needed=log.interval,
            allowed=high if log.interval > high else low,
        )
