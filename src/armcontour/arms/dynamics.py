"""Joint torques of a chain of rigid bodies, computed with pinocchio."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms.chain import Chain
from armcontour.errors import InvalidInput


class Dynamics:
    """Inverse dynamics of a chain; arrays are (n, dof), or (dof,) for one state.

    Args:
        chain: A chain with masses. Its armature is added to the torque of each joint separately.

    Raises:
        InvalidInput: The chain has no masses, or pinocchio is not installed.
    """

    def __init__(self, chain: Chain) -> None:
        if chain.masses is None:
            raise InvalidInput("A chain without masses has no dynamics: give the masses of links.")
        self.chain = chain
        self._pin: Any = pinocchio()
        # One model with gravity and one without: `path_terms` separates the gravity torque.
        self._model = _model(self._pin, chain)
        self._weightless = self._model.copy()
        self._weightless.gravity.linear = np.zeros(3)
        self._data = self._model.createData()
        self._weightless_data = self._weightless.createData()
        self._armature = np.asarray(chain.armature)
        self._friction = np.asarray(chain.viscous), np.asarray(chain.coulomb)
        self._falls = bool(np.any(chain.gravity))

    def torque(self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike) -> FloatArray:
        """Joint torques [N m] of links, payload, drives and gravity, without friction."""
        at, rate, second = self._rows(q, dq, ddq)
        found = self._rnea(self._model, self._data, at, rate, second)
        found += self._armature * second
        return found.reshape(np.shape(q))

    def friction(self, dq: npt.ArrayLike) -> FloatArray:
        """Joint torques [N m] of viscous and Coulomb friction."""
        rate = np.asarray(dq, dtype=np.float64)
        viscous, coulomb = self._friction
        return np.asarray(viscous * rate + coulomb * np.sign(rate))

    def path_terms(
        self, q: npt.ArrayLike, dq_ds: npt.ArrayLike, d2q_ds2: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coefficients a, b, c of the torque `a dds + b ds² + c` along a path, without friction.

        Args:
            q: Joint positions [rad], (n, dof).
            dq_ds: First derivatives by arc length [rad/m], same shape.
            d2q_ds2: Second derivatives by arc length [rad/m²], same shape.
        """
        at, first, second = self._rows(q, dq_ds, d2q_ds2)
        still = np.zeros_like(at)
        model, data = self._weightless, self._weightless_data
        a = self._rnea(model, data, at, still, first) + self._armature * first
        b = self._rnea(model, data, at, first, second) + self._armature * second
        shape = np.shape(q)
        return a.reshape(shape), b.reshape(shape), self._gravity(at).reshape(shape)

    def mass_matrix(self, q: npt.ArrayLike) -> FloatArray:
        """Mass matrix: torque per joint acceleration [kg m²], (n, dof, dof)."""
        (at,) = self._rows(q)
        n, dof = at.shape
        found = np.empty((n, dof, dof))
        crba, model, data = self._pin.crba, self._model, self._data
        for out, x in zip(found, at, strict=True):
            out[:] = crba(model, data, x)
        # pinocchio guarantees only the upper triangle.
        upper = np.triu(found)
        found = upper + np.swapaxes(np.triu(found, 1), -1, -2)
        found[:, range(dof), range(dof)] += self._armature
        return found.reshape(*np.shape(q), dof)

    def gravity(self, q: npt.ArrayLike) -> FloatArray:
        """Joint torques [N m] that hold links and payload against gravity."""
        (at,) = self._rows(q)
        return self._gravity(at).reshape(np.shape(q))

    def derivatives(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, *, gravity: bool = True
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Derivatives of the torque by position, velocity and acceleration, without friction.

        Args:
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
            gravity: Whether the torque includes gravity.

        Returns:
            Derivatives by position [N m/rad], by velocity [N m s/rad] and by acceleration, which is
            the mass matrix [kg m²], (n, dof, dof) each.
        """
        at, rate, second = self._rows(q, dq, ddq)
        model, data = self._model, self._data
        if not gravity:
            model, data = self._weightless, self._weightless_data
        found = np.empty((3, len(at), at.shape[1], at.shape[1]))
        compute = self._pin.computeRNEADerivatives
        for k, (x, v, a) in enumerate(zip(at, rate, second, strict=True)):
            found[0, k], found[1, k], found[2, k] = compute(model, data, x, v, a)
        # pinocchio guarantees only the upper triangle of the mass matrix.
        found[2] = np.triu(found[2]) + np.swapaxes(np.triu(found[2], 1), -1, -2)
        diagonal = np.arange(at.shape[1])
        found[2][:, diagonal, diagonal] += self._armature
        position, velocity, acceleration = found.reshape(3, *np.shape(q), at.shape[1])
        return position, velocity, acceleration

    def last_body_regressor(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, *, gravity: bool = True
    ) -> FloatArray:
        """Joint torques per parameter of the last body, of which they are linear.

        Args:
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
            gravity: Whether the torque includes gravity.

        Returns:
            Torques per mass, per first moments, and per moments of inertia xx, xy, yy, xz, yz and
            zz about the origin, all in the frame of the last joint, (n, dof, 10).
        """
        at, rate, second = self._rows(q, dq, ddq)
        model, data = self._model, self._data
        if not gravity:
            model, data = self._weightless, self._weightless_data
        compute, last = self._pin.computeJointTorqueRegressor, slice(10 * (at.shape[1] - 1), None)
        found = np.empty((*at.shape, 10))
        for out, x, v, a in zip(found, at, rate, second, strict=True):
            out[:] = compute(model, data, x, v, a)[:, last]
        return found

    def _gravity(self, q: FloatArray) -> FloatArray:
        """Joint torques [N m] of gravity, (n, dof)."""
        found = np.zeros_like(q)
        if self._falls:
            gravity, model, data = self._pin.computeGeneralizedGravity, self._model, self._data
            for out, x in zip(found, q, strict=True):
                out[:] = gravity(model, data, x)
        return found

    def _rnea(
        self, model: Any, data: Any, q: FloatArray, dq: FloatArray, ddq: FloatArray
    ) -> FloatArray:
        """Joint torques [N m] by the recursive Newton-Euler algorithm, (n, dof)."""
        # One Python call per row takes 1.3 us with the loop, most of it inside pinocchio.
        rnea, found = self._pin.rnea, np.empty_like(q)
        for out, x, v, a in zip(found, q, dq, ddq, strict=True):
            out[:] = rnea(model, data, x, v, a)
        return found

    def _rows(self, *states: npt.ArrayLike) -> list[FloatArray]:
        """The given states as rows, (n, dof) each.

        The shapes are checked because pinocchio would read past the end of a short row.

        Raises:
            InvalidInput: The shapes differ, or the number of columns is not that of the joints.
        """
        arrays = [np.asarray(x, dtype=np.float64) for x in states]
        shape, dof = arrays[0].shape, len(self.chain)
        if any(x.shape != shape for x in arrays) or shape[-1:] != (dof,):
            raise InvalidInput(
                f"The states of {dof} joints must be arrays of one shape with {dof} columns, not "
                f"{', '.join(str(x.shape) for x in arrays)}."
            )
        return [np.ascontiguousarray(x.reshape(-1, dof)) for x in arrays]


def pinocchio() -> Any:
    """The module pinocchio, imported at first use.

    Raises:
        InvalidInput: pinocchio is not installed.
    """
    try:
        import pinocchio as module
    except ImportError:
        raise InvalidInput(
            "Torques and robot descriptions need the package pin, which is not installed (it has "
            "no wheels for Windows): install it, or use an arm in the plane."
        ) from None
    return module


def _model(pin: Any, chain: Chain) -> Any:
    """Pinocchio's model of a chain with its payload."""
    model = pin.Model()
    model.gravity.linear = np.array(chain.gravity)
    joint = 0
    identity = pin.SE3.Identity()
    assert chain.masses is not None and chain.centers is not None and chain.inertias is not None
    for k, name in enumerate(chain.joints):
        joint = model.addJoint(
            joint,
            pin.JointModelRevoluteUnaligned(np.array(chain.axes[k])),
            pin.SE3(np.array(chain.rotations[k]), np.array(chain.positions[k])),
            name,
        )
        body = pin.Inertia(
            float(chain.masses[k]), np.array(chain.centers[k]), np.array(chain.inertias[k])
        )
        model.appendBodyToJoint(joint, body, identity)
    if chain.payload is not None:
        load = chain.payload
        body = pin.Inertia(load.mass, np.array(load.center), np.array(load.inertia))
        tip = pin.SE3(np.array(chain.tip.rotation), np.array(chain.tip.position))
        model.appendBodyToJoint(joint, body, tip)
    return model
