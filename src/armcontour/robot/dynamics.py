"""Joint torques of rigid-body chains, and their derivatives."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.robot.chain import Chain, joint_frames, state_rows


class Dynamics:
    """Inverse dynamics of a chain with masses; arrays are (n, dof), or (dof,) for one state.

    The torque is `tau = M(q) ddq + C(q, dq) dq + g(q)`, computed by the recursive Newton-Euler
    algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5), and includes the drives'
    armature. Joint positions are in rad, velocities in rad/s and accelerations in rad/s². For a
    prismatic joint, m replaces rad and N replaces N m.

    >>> ac.load_arm("ur5e").dynamics.gravity(np.zeros(6)).shape
    (6,)

    Args:
        chain: A chain with masses.

    Raises:
        InvalidInput: The chain has no masses.
    """

    def __init__(self, chain: Chain) -> None:
        if chain.masses is None:
            raise InvalidInput("Dynamics require the masses of the links, but the chain has none.")
        self.chain = chain
        arm = chain.arm_branch
        part = chain.part_branch
        first = chain.floor_link
        rest = np.arange(first, len(chain))
        # Each branch's joint columns, links and gravity. Bodies in different branches do not act on
        # each other.
        self._branches = [(rest, _link_data(arm), np.array(arm.gravity))]
        if part is not None:
            reversed_columns = np.arange(first)[::-1]
            self._branches.append((reversed_columns, _link_data(part), np.array(part.gravity)))
        self._friction = np.asarray(chain.viscous), np.asarray(chain.coulomb)
        self.has_friction = any(x.any() for x in self._friction)

    def torque(self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike) -> FloatArray:
        """Return joint torques [N m] due to inertia and gravity, without friction.

        Args:
            q: Joint positions [rad], (n, dof) or (dof,).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        _, moving, weight = self.path_terms(q, dq, ddq)
        return moving + weight

    def friction(self, dq: npt.ArrayLike) -> FloatArray:
        """Return the friction torques `viscous dq + coulomb sign(dq)` [N m].

        Args:
            dq: Joint velocities [rad/s], (n, dof) or (dof,).
        """
        rate = checks.floats("joint velocities", dq, "rad/s")
        viscous, coulomb = self._friction
        return np.asarray(viscous * rate + coulomb * np.sign(rate))

    def path_terms(
        self, q: npt.ArrayLike, dq_ds: npt.ArrayLike, d2q_ds2: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return a, b, c of the torque `a dds + b ds² + c` along a path, without friction.

        With `dq = q' ds` and `ddq = q' dds + q'' ds²`, they are `a = M q'`,
        `b = M q'' + C(q, q') q'` and `c = g` (Bobrow, Dubowsky and Gibson, 1985).

        Args:
            q: Joint positions [rad], (n, dof) or (dof,).
            dq_ds: First derivatives q' along the path [rad/m], same shape.
            d2q_ds2: Second derivatives q'' along the path [rad/m²], same shape.
        """
        from armcontour.robot import kernels

        leading, states = state_rows(len(self.chain), q, dq_ds, d2q_ds2)
        shape = (*leading, len(self.chain))
        if len(self._branches) == 1:
            # Without a positioner no columns are copied.
            _, links, gravity = self._branches[0]
            a, b, c = kernels.path_terms(links, gravity, *states)
            return a.reshape(shape), b.reshape(shape), c.reshape(shape)
        terms = np.empty((3, *states[0].shape))
        for columns, links, gravity in self._branches:
            rows = [np.ascontiguousarray(x[:, columns]) for x in states]
            terms[:, :, columns] = kernels.path_terms(links, gravity, *rows)
        a, b, c = terms.reshape(3, *shape)
        return a, b, c

    def mass_matrix(self, q: npt.ArrayLike) -> FloatArray:
        """Return the mass matrix M(q): torque per joint acceleration [kg m²], (n, dof, dof).

        Args:
            q: Joint positions [rad], (n, dof) or (dof,).
        """
        _, (positions,) = state_rows(len(self.chain), q)
        n, dof = positions.shape
        # Rows are the torques for a unit acceleration of one joint without gravity.
        one = np.tile(np.eye(dof), (n, 1))
        matrices, _, _ = self.path_terms(np.repeat(positions, dof, axis=0), one, np.zeros_like(one))
        matrices = matrices.reshape(n, dof, dof)
        return ((matrices + np.swapaxes(matrices, 1, 2)) / 2).reshape(*np.shape(q), dof)

    def gravity(self, q: npt.ArrayLike) -> FloatArray:
        """Return the joint torques g(q) [N m] that hold links and payload against gravity.

        Args:
            q: Joint positions [rad], (n, dof) or (dof,).
        """
        still = np.zeros(np.shape(q))
        return self.path_terms(q, still, still)[2]

    def derivatives(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, *, gravity: bool = True
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the torque's derivatives by q, dq and ddq, without friction, (n, dof, dof) each.

        They have the units N m/rad, N m s/rad and kg m²; the last one is the mass matrix.

        Args:
            q: Joint positions [rad], (n, dof) or (dof,).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
            gravity: Whether the torque includes gravity.
        """
        unit = np.eye(len(self.chain))
        _, states = state_rows(len(unit), q, dq, ddq)

        def change(order: int, step: float) -> FloatArray:
            """Return half the torque change from -step to step of a joint, (n, dof, joints)."""
            ends = []
            for end in (-step, step):
                moved = [x[:, None] + (k == order) * end * unit for k, x in enumerate(states)]
                _, moving, weight = self.path_terms(*moved)
                ends.append(moving + gravity * weight)
            return np.swapaxes(ends[1] - ends[0], 1, 2) / 2

        # The torque is a trigonometric polynomial of degree 2 in each position of a revolute joint,
        # and a quadratic polynomial in each other position and velocity, so these differences are
        # exact.
        position = (3 * change(0, math.pi / 3) - change(0, 2 * math.pi / 3)) / math.sqrt(3)
        slides = self.chain.slides
        if slides.any():
            position[..., slides] = change(0, 1.0)[..., slides]
        shape = (*np.shape(q), len(unit))
        return position.reshape(shape), change(1, 1.0).reshape(shape), self.mass_matrix(q)


def _link_data(chain: Chain) -> FloatArray:
    """Return link data for the compiled dynamics, (dof, 25), in frames with z on joint axes."""
    # Columns: rotation (9) and position (3) relative to the previous frame; mass; first moment (3);
    # inertia about the joint xx, xy, xz, yy, yz, zz; mass of this and all later links; armature; 1
    # for a prismatic joint, otherwise 0.
    assert chain.masses is not None and chain.centers is not None and chain.inertias is not None
    rows = np.zeros((len(chain), 25))
    before = np.eye(3)
    for k, (row, frame) in enumerate(zip(rows, joint_frames(chain), strict=True)):
        bodies = [(chain.masses[k], chain.centers[k], chain.inertias[k])]
        if chain.payload is not None and k == len(chain) - 1:
            load = chain.payload
            tip = chain.tip
            center = tip.position + tip.rotation @ load.center
            bodies.append((load.mass, center, tip.rotation @ load.inertia @ tip.rotation.T))
        row[:9] = (before.T @ chain.rotations[k] @ frame).ravel()
        row[9:12] = before.T @ chain.positions[k]
        for mass, center, inertia in bodies:
            centre = center @ frame
            about = frame.T @ inertia @ frame + mass * (
                centre @ centre * np.eye(3) - np.outer(centre, centre)
            )
            row[12] += mass
            row[13:16] += mass * centre
            row[16:22] += about[np.triu_indices(3)]
        before = frame
    rows[:, 22] = np.cumsum(rows[::-1, 12])[::-1]
    rows[:, 23] = chain.armature
    rows[:, 24] = chain.slides
    return rows
