"""`identify_on`: play motions on a robot, and identify its servos from their logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from armcontour.control.compensation import NoCompensation
from armcontour.control.identification import Identification, Prediction, ServoFit, identify
from armcontour.controllers.controller import Controller, Motion, PlayedMotion, per_joint
from armcontour.controllers.player import (
    BAND_LAG_OF_UNKNOWN_SERVO,
    Played,
    Player,
    lost_motion,
    plan_played,
    prepare_motion,
    uncompensated_motion,
)
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerLost, ControllerRefused
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import Reserve
from armcontour.core.render import Result
from armcontour.core.result import VERDICT, Data, Row
from armcontour.jobs.alternatives import clearance_of
from armcontour.jobs.job import Job, choose_run
from armcontour.motion import JointPath, Log, PathLaw, Trajectory
from armcontour.robot import Limits
from armcontour.robot.limit_use import States
from armcontour.robot.limits import JOINT_LIMITS, LIMITS

# Default reserve of the run, so that commanded accelerations do not saturate.
DEFAULT_RESERVE = 0.2
# Names of the two motions, and of their logs.
RUN = "run"
EXCITATION = "excitation"

# Duration of the excitation [s].
EXCITATION_DURATION = 12.0
# Duration of the fade-in at its start, and of the fade-out at its end [s].
EXCITATION_FADING = 2.0
# Frequencies of the first joint in the excitation [Hz].
FREQUENCIES = (0.31, 0.83, 1.9, 3.7)
# The frequencies of joint j are higher by the fraction j * DETUNED, so that the joints' motions are
# not correlated.
DETUNED = 0.17
# Maximum amplitude with which a revolute joint is excited [rad].
AMPLITUDE = 0.1
# The same for a linear axis [m].
AMPLITUDE_LINEAR = 0.1
# Fraction of the limits that the excitation uses.
LIMIT_SHARE = 0.6
# A smaller ratio to a limit is replaced by this one, so that no division by zero occurs.
SMALLEST_RATIO = 1e-9
# Interval between the states whose limits are checked [s].
LIMIT_CHECK_INTERVAL = 2e-3
# Maximum number of amplitudes that are tried near an obstacle or limit, each half of the previous
# one.
AMPLITUDE_HALVINGS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotIdentification(Result):
    """Motions of a robot, and the servos identified from their logs.

    Args:
        played: The motions by their names, `run` and `excitation`: the run without compensation,
            and a motion that excites all joints.
        stopped: True if a motion was stopped, was interrupted by a failure or did not start.
        lost: The failure of the controller during the last motion; None without one.
        fit: The identified servos; None in a dry run, or if a motion was stopped.
        prediction: The run as the identified servos predict it.
    """

    played: dict[str, Played]
    stopped: bool = False
    lost: ControllerLost | None = None
    fit: Identification | None = None
    prediction: Prediction | None = None

    @property
    def logs(self) -> dict[str, Log]:
        """Logs of the motions that were completed, by name."""
        return {
            name: replace(x.log, source=name)
            for name, x in self.played.items()
            if x.record is not None and x.record.stopped is None
        }

    def to_data(self) -> Data:
        """Return rows on the motions."""
        played_run = self.played[RUN]
        stopped = Row("stopped", self.stopped, "", "stopped", level=VERDICT)
        records = [x.record for x in self.played.values() if x.record is not None]
        notes = list[str]()
        if not played_run.executed and played_run.outputs_note:
            notes.append(played_run.outputs_note)
        for record in records:
            if record.stopped is not None:
                notes += record.notes
        title = f"Identification on {played_run.controller}"
        return Data(title, (*played_run.to_data().rows, stopped), notes=tuple(notes))


@checked
def identify_on(
    job: Job,
    controller: Controller,
    *,
    run_name: str | None = None,
    reserve: Reserve = DEFAULT_RESERVE,
    execute: bool = False,
    options: ServoFit | None = None,
    stop_requested: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
) -> RobotIdentification:
    """Play two motions on a robot, and identify its servos from them.

    The first motion is a run of the job without compensation. The second one excites all joints
    about the start of the run for 12 s by sums of sines. It stays within the limits, and the arm
    keeps clear of itself and its cell.

    Args:
        job: The job.
        controller: The controller, not connected.
        run_name: The run; by default the only one.
        reserve: Smallest reserve of its plan, by default 20 %.
        execute: Whether the robot moves; by default the motions are only planned and compared.
        options: Options of the identification; by default with the arm of the job.
        stop_requested: Called often during a motion; True stops it on its path.
        progress: Called with the steps.

    Raises:
        ControllerRefused: The controller differs from the plan, joints cannot be excited, or drives
            do not move.
        ControllerLost: The controller failed during a motion.
    """
    motions = prepare_identification(job, controller, run_name, reserve, progress)
    player = Player(controller, execute, stop_requested, progress)
    result = play_identification(motions, player, options or ServoFit(kinematics=job.arm))
    if result.lost is not None:
        raise result.lost
    return result


def prepare_identification(
    job: Job,
    controller: Controller,
    run_name: str | None,
    reserve: float,
    progress: Progress | None,
) -> dict[str, Played]:
    """Make the motions of an identification, by name, checked against the controller."""
    chosen = choose_run(job, run_name, "identified")
    uncompensated = replace(chosen, compensation=NoCompensation(), accuracy=None)
    job, planned = plan_played(
        replace(job, runs=(uncompensated,)), controller, None, reserve=reserve, progress=progress
    )
    ready = prepare_motion(job, planned, controller, lag=BAND_LAG_OF_UNKNOWN_SERVO)
    excitation = excite(job, planned.run.limits, planned.trajectory, controller.cycle)
    return {RUN: ready, EXCITATION: replace(ready, motion=excitation)}


def play_identification(
    motions: dict[str, Played], player: Player, options: ServoFit
) -> RobotIdentification:
    """Play the motions of an identification until one is stopped, and identify the servos.

    If the controller is lost, the result has the error and the motions until then.
    """
    played = {}
    for name, ready in motions.items():
        try:
            played[name] = player.play(ready, _is_complete)
        except ControllerLost as lost:
            played[name] = lost_motion(ready, lost)
            return RobotIdentification(played=played, stopped=True, lost=lost)
        record = played[name].record
        if player.execute and (record is None or record.stopped is not None):
            return RobotIdentification(played=played, stopped=True)
    result = RobotIdentification(played=played)
    if not player.execute:
        return result
    subprogress(player.progress, played[RUN].plan.run.name)(Step(("identifying",)))
    fit = identify(list(result.logs.values()), options, progress=player.progress)
    return replace(result, fit=fit, prediction=fit.predict(result.logs[RUN]))


def _is_complete(record: PlayedMotion) -> bool:
    """Return whether a motion need not be repeated; late set-points are in the log."""
    return record.stopped is None or record.deviated


def excite(job: Job, limits: Limits, base: Trajectory, cycle: float) -> Motion:
    """Make a motion about the start of a trajectory, within limits and without contact.

    Args:
        job: The job.
        limits: Limits of arm and tool.
        base: A plan of the arm with these limits.
        cycle: Cycle of the controller [s].

    Raises:
        ControllerRefused: The start is too near to a limit or to an obstacle.
    """
    start = base(0.0)
    t = np.arange(0.0, EXCITATION_DURATION + LIMIT_CHECK_INTERVAL / 2, LIMIT_CHECK_INTERVAL)
    lower, upper = limits.joint_range(len(start))
    amplitude = per_joint(job.arm, AMPLITUDE, AMPLITUDE_LINEAR, job.arm.dof)
    largest = np.minimum(amplitude, LIMIT_SHARE * np.minimum(start - lower, upper - start))
    j = int(largest.argmin())
    if largest[j] <= 0:
        raise ControllerRefused(f"Joint {j + 1} starts at the end of its range.", joint=j)
    sines = _sines(len(start), t)
    curve = make_interp_spline(t, sines * (largest / np.abs(sines).max(axis=0)), k=5)
    columns = [curve(t, order) for order in range(4)]
    # Scale each joint by its own limits first, then all joints by the limits of the tool.
    scaled = [x for x in JOINT_LIMITS if LIMITS[x].power]
    of_joints = [Limits.only(**{x: getattr(limits, x)}) for x in scaled]
    for group in (*of_joints, limits.of_tool):
        for use in States(job.arm, [columns[0] + start, *columns[1:]]).uses(group):
            ratio = use.ratio.max(axis=0)
            columns = [
                x * np.minimum(LIMIT_SHARE / np.maximum(ratio, SMALLEST_RATIO), 1.0)
                for x in columns
            ]
    for _ in range(AMPLITUDE_HALVINGS):
        states = States(job.arm, [columns[0] + start, *columns[1:]])
        q = states.q
        dq = states.dq
        ddq = states.ddq
        path = JointPath.hermite(t, (q[:-1], dq[:-1], ddq[:-1]), (q[1:], dq[1:], ddq[1:]))
        laws = (PathLaw.over_time(path),)
        trajectory = replace(base, laws=laws, path=None, stretches=(), spans=(), events=())
        clearance = clearance_of(job, trajectory)
        within_limits = all((x.ratio <= 1).all() for x in states.uses(limits))
        if within_limits and (clearance is None or clearance.satisfied):
            return uncompensated_motion(trajectory, job.arm, cycle)
        columns = [x / 2 for x in columns]
    reason = clearance.sentence if within_limits and clearance is not None else "a limit is active."
    raise ControllerRefused(f"The joints cannot be excited at the start of the run: {reason}")


def _sines(dof: int, t: FloatArray) -> FloatArray:
    """Return sums of sines for each joint at times t [s], from rest to rest, (n, dof)."""
    x = np.clip(np.minimum(t, t[-1] - t) / EXCITATION_FADING, 0.0, 1.0)[:, None]
    fade = x**4 * (35 - x * (84 - x * (70 - 20 * x)))
    joint = np.arange(dof)
    k = np.arange(len(FREQUENCIES))[:, None, None]
    w = 2 * np.pi * np.reshape(FREQUENCIES, (-1, 1, 1)) * (1 + DETUNED * joint)
    # Amplitudes decrease with the power 1.5 of the frequency, so velocities decrease and
    # accelerations increase with its square root.
    sines = np.sin(w * t[:, None] + 2.0 * joint + 1.3 * k) / w**1.5
    return np.asarray(fade * sines.sum(axis=0))
