"""Affine maps, by which drawings place their shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """The map `linear @ point + offset`."""

    linear: FloatArray
    offset: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Images of points, (..., dimension)."""
        return np.asarray(points @ self.linear.T + self.offset)

    def __matmul__(self, inner: Affine) -> Affine:
        """The composition of two maps: first the inner map, then this map."""
        # An overflow is found later, by `finite`.
        with np.errstate(over="ignore", invalid="ignore"):
            return Affine(self.linear @ inner.linear, self.linear @ inner.offset + self.offset)

    def turn(self, vectors: FloatArray) -> FloatArray:
        """Images of differences of points, (..., dimension), without the offset."""
        return np.asarray(vectors @ self.linear.T)

    @property
    def finite(self) -> bool:
        """Whether all coefficients are finite."""
        return bool(np.isfinite(self.linear).all() and np.isfinite(self.offset).all())


# Projection from space onto the plane z = 0.
WITHOUT_Z = Affine(np.eye(3)[:2], np.zeros(2))
