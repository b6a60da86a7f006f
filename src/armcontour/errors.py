"""Every error that armcontour raises on purpose.

```
ArmContourError
├── InvalidInput (also a ValueError)   the input is not of the form that is asked for
├── Unreachable                        the arm cannot bring its tool there
├── NotRealizable                      no timing of that kind keeps the limits
├── CompensationError                  the servo's delay cannot be compensated that way
└── ExecutionError                     the simulated servo did not complete the motion
```

Each has its exit code of the command line, 2 to 6 in this order. 0 and 1 are answers (`check`: all
limits kept, a limit violated; `identify`: determined, not determined), and 7 is the answer of
`check` that the samples cannot tell.

A message is one sentence: what is wrong, where, and what would mend it. The same facts stand as
attributes, in SI units, for programs. Sentences count from 1, as people do: joints, segments,
waypoints, corners, items of a list in a file. The attribute `index` counts from 0, as Python does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from armcontour._text import to_line


class ArmContourError(Exception):
    """Base of all armcontour errors.

    Args:
        message: One sentence for a person.
        point: Coordinates of the place [m].
        index: Position of the offending item in its input, from 0.
        s: Arc length of the place [m].
        t: Time of the event [s].
        joint: Joint number, from 1 as in the paper.
        limit: Name of the limit that binds.
        needed: Value that would be needed (unit of the limit).
        allowed: Value that is allowed (unit of the limit).
    """

    exit_code = 1

    def __init__(
        self,
        message: str,
        *,
        point: Sequence[float] | None = None,
        index: int | None = None,
        s: float | None = None,
        t: float | None = None,
        joint: int | None = None,
        limit: str | None = None,
        needed: float | None = None,
        allowed: float | None = None,
    ) -> None:
        # A sentence repeats what stands in files, which must not write to a terminal.
        super().__init__(to_line(message))
        self.point = None if point is None else tuple(float(x) for x in point)
        self.index = index
        self.s = s
        self.t = t
        self.joint = joint
        self.limit = limit
        self.needed = needed
        self.allowed = allowed

    def at(self, where: str) -> ArmContourError:
        """The same error with the same data, whose sentence begins with a place.

        Args:
            where: The place, such as the name of a file; a colon follows.
        """
        return type(self)(
            f"{where}: {self}",
            point=self.point,
            index=self.index,
            s=self.s,
            t=self.t,
            joint=self.joint,
            limit=self.limit,
            needed=self.needed,
            allowed=self.allowed,
        )


@contextmanager
def locate_errors(where: str) -> Iterator[None]:
    """Begin the sentence of an error that occurs inside with a place, such as a run's name."""
    try:
        yield
    except ArmContourError as error:
        raise error.at(where).with_traceback(error.__traceback__) from None


class InvalidInput(ArmContourError, ValueError):
    """The input is not of the form that is asked for."""

    exit_code = 2


class Unreachable(ArmContourError):
    """The arm cannot bring its tool there, or only at a singular configuration."""

    exit_code = 3


class NotRealizable(ArmContourError):
    """No timing of the requested kind keeps the limits."""

    exit_code = 4


class CompensationError(ArmContourError):
    """The servo's delay cannot be compensated in the requested way."""

    exit_code = 5


class ExecutionError(ArmContourError):
    """The simulated servo did not complete the motion."""

    exit_code = 6
