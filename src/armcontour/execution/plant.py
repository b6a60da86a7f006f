"""What every plant can do: take taught data, and say what the joints did."""

from __future__ import annotations

from abc import ABC, abstractmethod

from armcontour import _checks
from armcontour.errors import InvalidInput
from armcontour.motion import Execution, TaughtData


class Plant(ABC):
    """A robot, simulated: an arm with its drives."""

    @abstractmethod
    def run(self, taught: TaughtData, resolution: float) -> Execution:
        """Execute taught data, from rest at its first set-point until rest at its last.

        Args:
            taught: The set-points.
            resolution: Largest time between two results [s].
        """


def execute(taught: TaughtData, plant: Plant, *, resolution: float = 1e-3) -> Execution:
    """Execute taught data on a plant.

    Args:
        taught: The set-points.
        plant: The plant, never the model that the taught data was compensated with.
        resolution: Largest time between two results [s]; the motion itself does not depend on it.

    Raises:
        InvalidInput: Taught data for another number of joints.
        ExecutionError: The joints do not come to rest.
    """
    if not isinstance(plant, Plant):
        raise InvalidInput(f"A plant is needed to execute on, not {type(plant).__name__}.")
    return plant.run(taught, _checks.positive("resolution", resolution, "s"))
