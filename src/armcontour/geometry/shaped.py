"""Shaped paths: lines and arcs near an objective path, along which an arm moves in less time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.geometry.path import Path


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """How the shape of a path was found.

    Args:
        start: Name of the start that the path was shaped from, or that no shape was faster than:
            "arcs", "parabolas" or "stops".
        durations: Least durations of all starts by their names, and of the path itself as "shaped"
            [s].
        history: Least duration after each iteration, the first before any [s], (iterations + 1,).
    """

    start: str
    durations: Mapping[str, float]
    history: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "durations", MappingProxyType(dict(self.durations)))

    @property
    def gain(self) -> float:
        """Share of the duration of the fastest start that the shape saves."""
        starts = [x for name, x in self.durations.items() if name != "shaped"]
        return 1 - self.durations["shaped"] / min(starts)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapedPath(Path):
    """A path whose shape was found together with its timing, within a tolerance of its objective.

    Args:
        objective: The path before shaping.
        places: Arc lengths on the objective and on this path that belong together [m], from the
            start to the end, both increasing, (n, 2).
        tolerance: The given tolerance [m].
        line_tolerance: The given tolerance outside the zones of the vertices [m]; None if there
            are no zones.
        zone: Distance from a vertex, along the objective, within which `tolerance` holds [m].
        outcome: How the shape was found.

    Raises:
        InvalidInput: The places do not increase from start to end of both paths.
    """

    objective: Path
    places: FloatArray
    tolerance: float
    line_tolerance: float | None = None
    zone: float | None = None
    outcome: Outcome = field(repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        places = check_places(self.places, self.objective, self)
        object.__setattr__(self, "places", places)

    def place(self, s: npt.ArrayLike) -> FloatArray:
        """Arc lengths on this path that correspond to arc lengths on the objective path [m].

        Args:
            s: Arc lengths of the objective path [m], any shape.
        """
        found = np.interp(np.asarray(s, dtype=np.float64), self.places[:, 0], self.places[:, 1])
        return np.asarray(np.clip(found, 0.0, self.length))


def check_places(places: npt.ArrayLike, objective: Path, path: Path) -> FloatArray:
    """Places that belong together, locked, after a check that they lead along both paths.

    Args:
        places: Arc lengths on the objective and on the path [m], (n, 2).
        objective: The objective path.
        path: A path that was made from it.

    Raises:
        InvalidInput: The places do not increase from start to end of both paths.
    """
    found = _checks.lock_floats(places)
    ends = np.array([[0.0, 0.0], [objective.length, path.length]])
    near = 1e-9 * (1 + ends[1])
    if found.ndim != 2 or (np.abs(found[[0, -1]] - ends) > near).any():
        raise InvalidInput("The places of a shaped path must lead from its start to its end.")
    if (np.diff(found, axis=0) < 0).any():
        raise InvalidInput("The places of a shaped path must not decrease.")
    return found
