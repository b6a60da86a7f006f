"""The torques of a chain of rigid bodies, by pinocchio."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms.chain import Chain
from armcontour.errors import InvalidInput


class Dynamics:
    """What the motion of a chain costs in torque; arrays are (n, dof), or (dof,) for one state.

    Args:
        chain: With masses. Its armature is an inertia at each joint, apart from the bodies.

    Raises:
        InvalidInput: No masses, or pinocchio is not installed.
    """

    def __init__(self, chain: Chain) -> None:
        if chain.masses is None:
            raise InvalidInput("A chain without masses has no dynamics: give the masses of links.")
        self.chain = chain
        self._pin: Any = pinocchio()
        # With gravity, and without it: a torque along a path is wanted in parts.
        self._model = _model(self._pin, chain)
        self._weightless = self._model.copy()
        self._weightless.gravity.linear = np.zeros(3)
        self._data = self._model.createData()
        self._weightless_data = self._weightless.createData()
        self._armature = np.asarray(chain.armature)
        self._friction = np.asarray(chain.viscous), np.asarray(chain.coulomb)
        self._falls = bool(np.any(chain.gravity))

    def torque(self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike) -> FloatArray:
        """Torques [N m] of bodies, drives and gravity, without friction."""
        at, rate, second = self._rows(q, dq, ddq)
        found = self._rnea(self._model, self._data, at, rate, second)
        found += self._armature * second
        return found.reshape(np.shape(q))

    def friction(self, dq: npt.ArrayLike) -> FloatArray:
        """Torques [N m] that viscous and Coulomb friction cost."""
        rate = np.asarray(dq, dtype=np.float64)
        viscous, coulomb = self._friction
        return np.asarray(viscous * rate + coulomb * np.sign(rate))

    def path_terms(
        self, q: npt.ArrayLike, dq_ds: npt.ArrayLike, d2q_ds2: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """a, b and c of the torque `a dds + b ds² + c` along a path, without friction."""
        at, first, second = self._rows(q, dq_ds, d2q_ds2)
        still = np.zeros_like(at)
        model, data = self._weightless, self._weightless_data
        a = self._rnea(model, data, at, still, first) + self._armature * first
        b = self._rnea(model, data, at, first, second) + self._armature * second
        shape = np.shape(q)
        return a.reshape(shape), b.reshape(shape), self._gravity(at).reshape(shape)

    def mass_matrix(self, q: npt.ArrayLike) -> FloatArray:
        """Torque per joint acceleration [kg m²], (n, dof, dof)."""
        (at,) = self._rows(q)
        n, dof = at.shape
        found = np.empty((n, dof, dof))
        crba, model, data = self._pin.crba, self._model, self._data
        for out, x in zip(found, at, strict=True):
            out[:] = crba(model, data, x)
        # Only the upper triangle is promised.
        upper = np.triu(found)
        found = upper + np.swapaxes(np.triu(found, 1), -1, -2)
        found[:, range(dof), range(dof)] += self._armature
        return found.reshape(*np.shape(q), dof)

    def _gravity(self, q: FloatArray) -> FloatArray:
        found = np.zeros_like(q)
        if self._falls:
            gravity, model, data = self._pin.computeGeneralizedGravity, self._model, self._data
            for out, x in zip(found, q, strict=True):
                out[:] = gravity(model, data, x)
        return found

    def _rnea(
        self, model: Any, data: Any, q: FloatArray, dq: FloatArray, ddq: FloatArray
    ) -> FloatArray:
        # One call from Python per row: 1.3 us with the loop, of which pinocchio takes most.
        rnea, found = self._pin.rnea, np.empty_like(q)
        for out, x, v, a in zip(found, q, dq, ddq, strict=True):
            out[:] = rnea(model, data, x, v, a)
        return found

    def _rows(self, *states: npt.ArrayLike) -> list[FloatArray]:
        """The states as rows of one shape, checked: pinocchio would read past a short row."""
        arrays = [np.asarray(x, dtype=np.float64) for x in states]
        shape, dof = arrays[0].shape, len(self.chain)
        if any(x.shape != shape for x in arrays) or shape[-1:] != (dof,):
            raise InvalidInput(
                f"The states of {dof} joints must be arrays of one shape with {dof} columns, not "
                f"{', '.join(str(x.shape) for x in arrays)}."
            )
        return [np.ascontiguousarray(x.reshape(-1, dof)) for x in arrays]


def pinocchio() -> Any:
    """The module of rigid bodies.

    Raises:
        InvalidInput: It is not installed.
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
    model = pin.Model()
    model.gravity.linear = np.array(chain.gravity)
    joint = 0
    here = pin.SE3.Identity()
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
        model.appendBodyToJoint(joint, body, here)
    if chain.payload is not None:
        load = chain.payload
        carried = pin.Inertia(load.mass, np.array(load.center), np.array(load.inertia))
        tip = pin.SE3(np.array(chain.tip.rotation), np.array(chain.tip.position))
        model.appendBodyToJoint(joint, carried, tip)
    return model
