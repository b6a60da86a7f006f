"""Forms of limits and the compiled pass, compared with references in NumPy."""

import numpy as np
import pytest
from scipy.optimize import linprog

import armcontour as ac
from armcontour.planning.constraints import Constraint, JointTorque, constraints_of, limits_on
from armcontour.planning.path_grid import place_grid
from armcontour.planning.topp.friction_rows import rows_with_friction
from armcontour.planning.topp.grid_plan import plan_on_grid
from armcontour.planning.topp.limit_forms import (
    HIGH,
    LOW,
    A,
    B,
    Ceiling,
    Friction,
    LinearRows,
    MotionBounds,
    Rounds,
    Squares,
)
from armcontour.planning.topp.plan_rules import Rules
from armcontour.planning.topp.sampled_joint_path import SampledJointPath

RNG = np.random.default_rng(4)
UR5E = ac.load_arm("ur5e")
PATH = ac.JointPath.spline(RNG.uniform(-1.2, 1.2, (5, 6)))
LIMITS = ac.Limits.only(joint_velocity=np.full(6, 2.0), joint_acceleration=np.full(6, 8.0))


def sampled_path(intervals=40):
    return SampledJointPath(place_grid(PATH, intervals))


def inside(path, order):
    """A derivative of the joint path at 33 places of every interval, (33, n, dof)."""
    share = np.linspace(0, 1, 33)[:, None]
    s = path.grid.s[:-1] + share * path.grid.width
    piece = np.broadcast_to(path.grid.piece, s.shape)
    return PATH.on_interval(piece.ravel(), s.ravel(), order).reshape(*s.shape, -1)


def rise_of(value):
    """How far a function at 33 places of every interval is above its chord, and below it."""
    share = np.linspace(0, 1, 33).reshape(-1, *[1] * (value.ndim - 1))
    return np.abs(value - (value[0] + share * (value[-1] - value[0]))).max(axis=0)


def motions(path, count=20):
    """Values of x and u inside the intervals, (33, n, 1) each, and their bounds."""
    w = path.grid.width
    t = np.linspace(0, 1, 33)[:, None] * w
    for seed in range(count):
        rng = np.random.default_rng(seed)
        x0 = rng.uniform(0.5, 2, len(path))
        u0 = rng.uniform(-0.1, 0.1, len(path)) / w
        k = rng.uniform(-0.1, 0.1, len(path)) / w**2
        x = x0 + 2 * u0 * t + k * t**2
        u = u0 + k * t
        bounds = np.abs(u).max(axis=0), x.max(axis=0), np.abs(k), np.ones(len(path))
        yield x[..., None], u[..., None], np.stack(bounds, axis=1)


def test_dense_samples_stay_within_the_bounds_of_sampled_forms():
    viscous = np.array([15.0, 15.0, 10.0, 3.0, 3.0, 2.0])
    chain = UR5E.chain.replace(viscous=viscous)
    arm = ac.SerialArm(name="rubbing", chain=chain, limits=UR5E.limits)
    path = sampled_path(400)
    share = np.linspace(0, 1, 33)[:, None]
    s = path.grid.s[:-1] + share * path.grid.width
    piece = np.broadcast_to(path.grid.piece, s.shape).ravel()
    q, first, second = (PATH.on_interval(piece, s.ravel(), k) for k in range(3))
    terms = [x.reshape(*s.shape, 6) for x in arm.dynamics.path_terms(q, first, second)]
    limits = limits_on(path, [JointTorque(arm, np.full(6, 400.0))])
    ends = limits.rows.ends
    np.testing.assert_allclose(ends[:, 0, :, A], terms[0][0], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(ends[:, 1, :, HIGH], 400 - terms[2][-1], rtol=1e-7, atol=1e-7)
    drag = viscous * first.reshape(*s.shape, 6)
    for x, u, bounds in motions(path, 5):
        by_u, by_x, alone = terms
        bound = np.einsum("nrk,nk->nr", limits.rows.rise, bounds)
        value = by_u * u + by_x * x + alone
        assert (rise_of(value) <= bound + 1e-9).mean() > 0.999  # samples in middles prove nothing
        near = MotionBounds(
            x.max(axis=(0, 2)), x.min(axis=(0, 2)), bounds[:, 0].copy(), bounds[:, 2].copy()
        )
        rows = rows_with_friction(path.grid.width, limits, near, True)
        total = value + drag * np.sqrt(x)
        for side, (column, sign) in enumerate(((HIGH, 1), (LOW, -1))):
            rows_of_side = slice(6 * side, 6 * side + 6)
            a, b, limit = (rows.ends[:, :, rows_of_side, k] for k in (A, B, column))
            margin = np.einsum("nrk,nk->nr", rows.rise[:, rows_of_side], bounds)
            used = [sign * (a[:, e] * u[-e] + b[:, e] * x[-e] - limit[:, e]) for e in range(2)]
            excess = sign * total.copy() if sign > 0 else -total
            worst = (excess - 400).max(axis=0)
            assert (worst <= np.maximum(*used) + margin + 1e-9).mean() > 0.999


def largest_by_programs(path, ends):
    """The largest x by a linear program for each interval, backward and forward."""
    width = path.grid.width
    n = len(width)
    ceilings = (4 / path.derivatives[0][0] ** 2).min(axis=2)

    def lines(i):
        """Rows, of x at the start and of the mean u, and their bounds."""
        w = width[i]
        a, b = ends[i, :, :, A], ends[i, :, :, B]
        rows = np.concatenate([np.stack([b[0], a[0]], 1), np.stack([b[1], a[1] + 2 * w * b[1]], 1)])
        high = ends[i, :, :, HIGH].ravel()
        low = ends[i, :, :, LOW].ravel()
        cap = ceilings[i].tolist()
        rows = np.concatenate([rows, -rows, [[1, 0], [1, 2 * w], [0, 0], [-1, -2 * w]]])
        return rows, np.concatenate([high, -low, cap, [0, 0]]), w

    upper = np.zeros(n + 1)
    x = np.zeros(n + 1)
    for i in range(n - 1, -1, -1):
        rows, right, w = lines(i)
        right[-3] = min(right[-3], upper[i + 1])
        solution = linprog([-1, 0], rows, right, bounds=[(0, None), (None, None)], method="highs")
        upper[i] = solution.x[0]
    for i in range(n):
        rows, right, w = lines(i)
        right[-3] = min(right[-3], upper[i + 1])
        solution = linprog(
            [0, -1], rows, right, bounds=[(x[i], x[i]), (None, None)], method="highs"
        )
        x[i + 1] = x[i] + 2 * w * solution.x[1]
    return x


def test_the_forward_pass_equals_linear_programs():
    path = sampled_path(60)
    (motion,) = constraints_of(PATH, UR5E, LIMITS)
    law = plan_on_grid(path.intervals, limits_on(path, [motion]), Rules(tries=1))
    expected = largest_by_programs(path, motion.rows(path).ends)
    np.testing.assert_allclose(law.x, expected, rtol=1e-6, atol=1e-9)


class Own(Constraint):
    """A constraint of the user with one form."""

    name = "force"

    def __init__(self, form):
        self.form = form

    def discretize(self, path):
        return (self.form,)


RIGHT = {
    LinearRows: {"ends": (5, 2, 3, 4), "rise": (5, 3, 4)},
    Squares: {"ends": (5, 2, 3), "largest": (5, 3), "rise": (5, 3, 4)},
    Rounds: {"ends": (5, 2, 3, 2, 3), "radius": (5, 3), "rise": (5, 3, 4)},
    Friction: {"viscous": (5, 2, 3), "within": (5, 3, 3)},
    Ceiling: {"x": (5, 2)},
}


@pytest.mark.parametrize("form", RIGHT, ids=lambda x: x.__name__)
def test_arrays_of_the_wrong_shape_are_refused_with_their_name(form):
    """Compiled functions would read beyond them."""
    line = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.5)])
    path = SampledJointPath(place_grid(line, 5))
    limits_on(path, [Own(form(**{name: np.ones(x) for name, x in RIGHT[form].items()}))])
    for name, shape in RIGHT[form].items():
        for k in range(len(shape)):
            arrays = {x: np.ones(y) for x, y in RIGHT[form].items()}
            arrays[name] = np.ones((*shape[:k], shape[k] + 1, *shape[k + 1 :]))
            if name == list(RIGHT[form])[-1] and shape[k] == 3 and form is not Friction:
                continue  # the last array says how many rows there are
            with pytest.raises(ac.InvalidInput, match="constraint force has the shape"):
                limits_on(path, [Own(form(**arrays))])
