"""Affine maps, which place the shapes of drawings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """`linear @ point + offset`."""

    linear: FloatArray
    offset: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Points, (..., dimension), where the map takes them."""
        return np.asarray(points @ self.linear.T + self.offset)

    def __matmul__(self, inner: Affine) -> Affine:
        """The inner map first, then this one."""
        # What is too large for a number is found by `finite`.
        with np.errstate(over="ignore", invalid="ignore"):
            return Affine(self.linear @ inner.linear, self.linear @ inner.offset + self.offset)

    def turn(self, vectors: FloatArray) -> FloatArray:
        """Differences of points, (..., dimension), as the map changes them."""
        return np.asarray(vectors @ self.linear.T)

    @property
    def finite(self) -> bool:
        """Whether none of its numbers has overflown."""
        return bool(np.isfinite(self.linear).all() and np.isfinite(self.offset).all())


# From space to the plane.
WITHOUT_Z = Affine(np.eye(3)[:2], np.zeros(2))
