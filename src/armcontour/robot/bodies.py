"""Rigid bodies: payloads, bodies that are joined, and inertias that bodies can have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.frames import Frame
from armcontour.core.quantities import Axes, Convert, Inertia, Items, Key, Mass, Quantity

INERTIA = Quantity("kg m^2")
# A file has the components xx, xy, xz, yy, yz and zz of the symmetric tensor.
TENSOR = Key(
    hint=Annotated[
        list[Inertia],
        Items(6, 6),
        Convert(lambda x: np.array(x)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]),
    ],
    text="xx, xy, xz, yy, yz and zz about the centre of mass, along the axes of the tip [kg m²]; a "
    "point by default.",
)


@declared(eq=False)
class Payload(Checked):
    """A load at the tool, in the frame of the chain's tip.

    >>> payload = ac.Payload(mass=2.0, center=(0.0, 0.0, 0.05))
    >>> arm.with_dynamics(payload=payload).has_bodies
    True

    Args:
        mass: Mass of the load [kg].
        center: The load's centre of mass [m], (3,).
        inertia: Inertia about the centre of mass, along the tip's axes [kg m²], (3, 3); by default
            that of a point mass.

    Raises:
        InvalidInput: The mass is negative, or no body can have this inertia.
    """

    mass: Mass = field(kw_only=False)
    center: Annotated[FloatArray, Quantity("m", "5 mm"), Axes(3)] = field(
        default_factory=lambda: np.zeros(3), kw_only=False
    )
    inertia: Annotated[FloatArray, INERTIA, Axes(3, 3), TENSOR] = field(
        default_factory=lambda: np.zeros((3, 3))
    )

    def _check_together(self) -> None:
        check_inertia("the payload", self.inertia)


def place_payload(payload: Payload, frame: Frame) -> Payload:
    """Transform a payload that is given in a frame to the frame in which that frame is given."""
    turn = frame.rotation
    inertia = turn @ payload.inertia @ turn.T
    return Payload(
        mass=payload.mass,
        center=frame.position + turn @ payload.center,
        # The products are symmetric only up to rounding errors.
        inertia=(inertia + inertia.T) / 2,
    )


def merge_bodies(
    bodies: Sequence[tuple[float, FloatArray, FloatArray]],
) -> tuple[float, FloatArray, FloatArray]:
    """Return mass [kg], centre [m] and inertia about it [kg m²] of rigidly joined bodies.

    The inertia about the common centre c follows from the parallel-axis theorem,
    `sum(I_k + m_k (|d_k|² E - d_k d_kᵀ))` with `d_k = c_k - c`.

    Args:
        bodies: Mass [kg], centre of mass [m], (3,), and inertia about it [kg m²], (3, 3), of each
            body, in one frame. The total mass must be positive.
    """
    masses, centers, inertias = (np.array(x) for x in zip(*bodies, strict=True))
    mass = float(masses.sum())
    center = masses @ centers / mass
    away = centers - center
    apart = (masses[:, None] * away).T @ away
    inertia = inertias.sum(axis=0) + np.trace(apart) * np.eye(3) - apart
    return mass, center, (inertia + inertia.T) / 2


def check_inertia(who: str, inertia: npt.ArrayLike) -> None:
    """Check that a rigid body can have an inertia matrix, (3, 3) [kg m²].

    Its principal moments must not be negative, and none may exceed the sum of the two others.
    `who` names the body in the message.
    """
    matrix = np.asarray(inertia, dtype=np.float64)
    size = float(np.abs(matrix).max())
    if np.abs(matrix - matrix.T).max() > 1e-9 * size:
        raise InvalidInput(f"The inertia of {who} must be symmetric.")
    moments = np.linalg.eigvalsh(matrix)
    if moments[0] < -1e-9 * size or moments[2] > (moments[0] + moments[1]) * (1 + 1e-6) + 1e-12:
        raise InvalidInput(
            f"No body can have the inertia of {who}, because its principal moments are "
            f"{', '.join(f'{x:.4g}' for x in moments)} kg m², and none may be negative or exceed "
            "the sum of the two others."
        )
