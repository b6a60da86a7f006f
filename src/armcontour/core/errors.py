"""The exceptions of armcontour.

```
ArmContourError
├── InvalidInput (also a ValueError)   the input does not have the required form
│   ├── FileError                      a file or folder cannot be read or written
│   └── ArmMismatch                    the input belongs to an arm with other joints
├── Unreachable                        the tool cannot reach a position or pose
├── NotRealizable                      no timing of this method satisfies the limits
├── CompensationError                  the servo's delay cannot be compensated by this method
├── ExecutionError                     the simulated servo did not complete the motion
├── Collision                          a distance to the arm itself or to the cell is too small
├── ControllerRefused                  a robot controller differs from the plan
└── ControllerLost                     a robot controller failed during a motion
```

The exit codes of the command line are 2 to 6 in this order, 8 for a collision, and 10 and 11 for
controllers. 0 and 1 are results (`check`: all limits satisfied, a limit violated; `identify`: all
joints have a model, or not). 7 is the result of `check` if its verdict is "cannot tell".

A message states the problem, its location and a fix. Attributes have the same facts in SI units,
for programs. Messages count joints, segments, waypoints, corners and items of a list in a file from
1. The attributes `index` and `joint` count from 0, as in Python.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager

from armcontour.core.text import Keys, key_text, to_line


class ArmContourError(Exception):
    """Base of all armcontour errors.

    >>> error = ac.ArmContourError("The tool cannot get there.", s=0.12)
    >>> error.exit_code, error.s
    (1, 0.12)

    Args:
        message: Problem, location and fix, for the user.
        point: Coordinates of the position [m].
        index: Index of the wrong item in its input, from 0.
        s: Arc length of the position [m].
        origin: Place in the file that defines the path at the position, such as "line 12 (N120)";
            empty if unknown.
        t: Time of the event [s].
        joint: Index of the joint, from 0; the message counts joints from 1, as the paper does.
        limit: Name of the active limit, or of the doubt about a measurement.
        needed: Required value (unit of the limit).
        allowed: Allowed value (unit of the limit).
        key: Names and indices, from 0, of the wrong value: keys of a file, from the outermost one,
            or the field of a class or the argument of a function. Empty if unknown.
        value: The wrong value, for a file as it is written; None if unknown.
        remedies: Alternative fixes: values as in a file, by keys relative to `key`; None to remove
            a key.
    """

    exit_code = 1

    def __init__(
        self,
        message: str,
        *,
        point: Sequence[float] | None = None,
        index: int | None = None,
        s: float | None = None,
        origin: str = "",
        t: float | None = None,
        joint: int | None = None,
        limit: str | None = None,
        needed: float | None = None,
        allowed: float | None = None,
        key: Keys = (),
        value: object = None,
        remedies: Sequence[Mapping[Keys, str | float | None]] = (),
    ) -> None:
        # Messages repeat text of files, which must not control the terminal.
        super().__init__(to_line(message))
        self.point = None if point is None else tuple(float(x) for x in point)
        self.index = index
        self.s = s
        self.origin = origin
        self.t = t
        self.joint = joint
        self.limit = limit
        self.needed = needed
        self.allowed = allowed
        self.key = key
        self.value = value
        self.remedies = tuple(remedies)

    def with_location(self, location: str) -> ArmContourError:
        """Copy the error and put a location before its message.

        Args:
            location: The location, such as the name of a file; a colon follows.
        """
        error = type(self)(f"{location}: {self}")
        vars(error).update(vars(self))
        return error


@contextmanager
def error_context(location: str, *keys: str | int) -> Iterator[None]:
    """Add a location, such as a run's name, and keys of a file to errors in this context."""
    # An empty location is not added. An error that has the whole key already keeps it.
    try:
        yield
    except ArmContourError as error:
        located = error.with_location(location) if location else error
        if keys and error.key[:1] != keys[:1]:
            located.key = (*keys, *error.key)
        raise located.with_traceback(error.__traceback__) from None


def key_context(*keys: str | int) -> AbstractContextManager[None]:
    """Add keys of a file to the message and the key of errors in this context."""
    return error_context(key_text(keys), *keys)


class InvalidInput(ArmContourError, ValueError):
    """The input does not have the required form.

    >>> issubclass(ac.InvalidInput, ValueError), ac.InvalidInput.exit_code
    (True, 2)
    """

    exit_code = 2


class FileError(InvalidInput):
    """A file or folder cannot be read or written; the values in it were not judged.

    The file is missing, too large, not text, of an unsupported kind or in use, or writing would
    replace files that armcontour did not write. Catch it to choose another file or to try again.

    >>> from armcontour.files import FileError
    >>> try:
    ...     ac.read_job("missing.yaml")
    ... except FileError as error:
    ...     print(error)
    There is no job file missing.yaml.
    """


class ArmMismatch(InvalidInput):
    """The input is for another arm: joints, their order or the coordinates of the tool differ.

    Catch it to choose the arm of a log, a trajectory or a path.

    >>> from armcontour.robot import ArmMismatch
    >>> try:
    ...     ac.trace(path, ac.load_arm("ur5e"))
    ... except ArmMismatch as error:
    ...     print(error)
    The path has 2 coordinates, but the tool of the arm UR5e has 3. Use a path with 3 coordinates.
    """


class Unreachable(ArmContourError):
    """The tool cannot reach a position or pose, or only in a singular configuration.

    >>> ac.Unreachable("The tool cannot get there.", s=0.2).s
    0.2
    """

    exit_code = 3


class NotRealizable(ArmContourError):
    """No timing of the required method satisfies the limits.

    >>> ac.NotRealizable("No timing keeps the limit.", limit="joint_torque").limit
    'joint_torque'
    """

    exit_code = 4


class CompensationError(ArmContourError):
    """The servo's delay cannot be compensated by the required method.

    >>> ac.CompensationError("The poles are not stable.").exit_code
    5
    """

    exit_code = 5


class ExecutionError(ArmContourError):
    """The simulated servo did not complete the motion.

    >>> ac.ExecutionError("The joints do not come to rest.", joint=1).exit_code
    6
    """

    exit_code = 6


class Collision(ArmContourError):
    """A distance of the arm to itself or to an obstacle is below the required clearance.

    >>> ac.Collision("The arm touches the table.", needed=0.01, allowed=0.0).exit_code
    8

    Attributes:
        bodies: Names of the two bodies that are too near to each other; empty if unknown.
        clearance: All distances of the motion, a `Clearance`; None if unknown.
    """

    exit_code = 8
    bodies: tuple[str, ...] = ()
    clearance: object | None = None


class ControllerRefused(ArmContourError):
    """A robot controller cannot be reached or differs from the plan, or drives do not follow."""

    exit_code = 10


class ControllerLost(ArmContourError):
    """A robot controller or the connection to it failed during a motion.

    Attributes:
        record: Recorded motion until the failure, a `PlayedMotion`; None if there is none.
    """

    exit_code = 11
    record: object | None = None
