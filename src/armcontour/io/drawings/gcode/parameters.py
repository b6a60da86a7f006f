"""Parameters of a program: numbered, named, and those that tell the state of the machine."""

from __future__ import annotations

import math
from collections.abc import Callable

from armcontour.io.drawings.gcode.faults import Fault

# Numbers of parameters (LinuxCNC manual, "Numbered Parameters"): arguments of subprograms, those
# that a program may use as it likes, and all.
ARGUMENTS = 30
FREE = 5000
LAST = 5602
# Of those above, a program may set the results of a probe, and whether messages are shown.
SCRATCH = (*range(5061, 5071), 5599)
# Named parameters at one time: no program that a person reads has more.
MOST_NAMES = 10_000

Key = int | str
State = Callable[[Key], float | None]


class Parameters:
    """Values of parameters, by number or by name.

    Names that start with an underscore are global; others belong to the subprogram that sets them.

    Args:
        state: Value of a parameter that tells the state of the machine, None for any other.
    """

    def __init__(self, state: State) -> None:
        self._state = state
        self._numbered: dict[int, float] = {}
        self._global: dict[str, float] = {}
        self._scopes: list[dict[str, float]] = [{}]
        self._saved: list[dict[int, float]] = []
        self.unset: int | None = None

    def get(self, key: Key) -> float:
        """The value of a parameter; 0 of a numbered one that was never set, NaN of a pin (`_hal`).

        Raises:
            Fault: A named one that was never set, or one whose value only a controller knows.
        """
        if isinstance(key, str):
            names = self._global if key.startswith("_") else self._scopes[-1]
            value = names.get(key)
        else:
            value = self._numbered.get(key)
        if value is None:
            value = self._state(key)
        if value is not None:
            return value
        if isinstance(key, str) and key.startswith("_hal["):
            # Known to the controller when the program runs; as a feed rate it may stay open.
            return math.nan
        if isinstance(key, str):
            raise Fault(f"the parameter #<{key}>, which nothing has set: assign it before")
        if key > FREE:
            raise Fault(
                f"the parameter #{key}, whose value is in the controller and not in the file: "
                "write the number"
            )
        self.unset = self.unset or key
        return 0.0

    def set(self, key: Key, value: float) -> None:
        """Assigns a value.

        Raises:
            Fault: A parameter that tells the state of the machine, or too many names.
        """
        if isinstance(key, int):
            if key > FREE and key not in SCRATCH:
                raise Fault(
                    f"a value for the parameter #{key}, which belongs to the controller: set "
                    "offsets with G10, G52 or G92, and positions with G28.1 or G30.1"
                )
            self._numbered[key] = value
            return
        if key.startswith(("_hal[", "_ini[")) or self._state(key) is not None:
            raise Fault(f"a value for the parameter #<{key}>, which only tells what is so")
        names = self._global if key.startswith("_") else self._scopes[-1]
        names[key] = value
        if len(names) > MOST_NAMES:
            raise Fault(f"more than {MOST_NAMES} named parameters: use fewer")

    def assign(self, key: Key, value: float) -> None:
        """Sets a global value that the reader itself gives, such as `#<_value>`."""
        self._global[str(key)] = value

    def exists(self, key: Key) -> bool:
        """Whether a named parameter has a value."""
        if isinstance(key, int):
            return True
        names = self._global if key.startswith("_") else self._scopes[-1]
        return key in names or self._state(key) is not None

    def enter(self, arguments: list[float]) -> None:
        """Starts the scope of a subprogram, whose arguments are #1, #2 and so on."""
        own = range(1, ARGUMENTS + 1)
        self._saved.append({i: self._numbered[i] for i in own if i in self._numbered})
        self._scopes.append({})
        self._numbered.update(enumerate(arguments, 1))

    def leave(self) -> None:
        """Ends the scope of a subprogram."""
        for i in range(1, ARGUMENTS + 1):
            self._numbered.pop(i, None)
        self._numbered.update(self._saved.pop())
        self._scopes.pop()

    @staticmethod
    def number_of(value: float) -> int:
        """The number of a parameter from a value.

        Raises:
            Fault: No whole number, or none of a parameter.
        """
        if not 0.5 < value < LAST + 0.5 or abs(value - round(value)) > 1e-4:
            raise Fault(f"#{value:g}, which is no parameter: they are #1 to #{LAST}")
        return round(value)

    @staticmethod
    def show(key: Key) -> str:
        """How a parameter is written."""
        return f"#{key}" if isinstance(key, int) else f"#<{key}>"
