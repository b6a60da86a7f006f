"""Attack certificates of boxes: by climbing, by robots inside the box, and by another envelope.

The attacks have their own integration of servos and their own distances.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path as FilePath

import numpy as np
from scipy.spatial import cKDTree

import armcontour as ac
from armcontour.core.checks import FloatArray
from armcontour.files import parse_job
from armcontour.files.job_file import read_cell
from armcontour.jobs import Uncertainty
from soak import Outcome

DRAWINGS = FilePath(__file__).parents[1] / "examples" / "drawings"
# Centres of random paths in the reach of the arms [m].
CENTRES = {"ur5e": (0.45, 0.0, 0.25), "panda": (0.45, 0.0, 0.35), "ur10e": (0.7, 0.0, 0.3)}
# Time between two results of the own simulation [s].
STEP = 2e-3
# Duration of the own simulation after the last set-point [s].
REST = 0.4
# Number of points by which a contour is measured.
SAMPLES = 30_001
# Numbers of random corners and random robots inside the box.
DRAWN = 40


def draw(seed: int) -> str:
    """Draw a random job with a box, as text of a job file."""
    random = np.random.default_rng(seed)
    arm = [*CENTRES][seed % len(CENTRES)]
    points = CENTRES[arm] + np.cumsum(
        random.uniform(-0.06, 0.06, size=(4, 3)) * (1, 1, 0.3), axis=0
    )
    texts = ", ".join(f"[{x:.4f}, {y:.4f}, {z:.4f}]" for x, y, z in points)
    shared = ", shared: true" if random.random() < 0.25 else ""
    feedforward = np.random.default_rng([seed, 1]).choice([0.0, 0.0, 0.7, 1.0])
    return f"""
name: box
arm: {arm}
path: {{points: [{texts}], orientation: {{axis: [0, 0, -1]}}}}
limits: {{speed: {random.uniform(0.1, 0.3):.3f} m/s, joint_torque: inf}}
corners: {{tolerance: {random.uniform(0.2, 1.0):.2f} mm}}
servo:
  kp: {random.uniform(15, 40):.1f} 1/s
  kv: {random.uniform(120, 250):.0f} 1/s
  dead_time: 8 ms
  velocity_feedforward: {feedforward}
cycle: {random.choice([2, 4, 8])} ms
certificate:
  servo_error: {random.uniform(0.3, 0.8):.2f} mm
  slowest: 5
  box: {{gains: {random.uniform(2, 8):.1f} %, dead_time: {random.uniform(0, 1):.2f} ms{shared}}}
runs: {{only: {{compensation: {{method: inverse}}}}}}
"""


def certify(seed: int) -> ac.Certificate:
    """Certify the gasket (seed 0), or a random job."""
    if seed:
        return ac.certify(parse_job(draw(seed)))
    servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=8e-3)
    job = read_cell("ur5e", DRAWINGS / "gasket.dxf")
    job = replace(job, servo=servo, plant_servo=servo)
    box = Uncertainty(gains=0.05, dead_time=0.5e-3)
    return ac.certify(job, goal=ac.CertificateGoal(servo_error=0.3e-3, slowest=3.0, box=box))


def attack(certificate: ac.Certificate, seed: int) -> dict[str, float]:
    """Return the largest ratios of errors in the box to the guarantees, by kind of attack."""
    random = np.random.default_rng(seed)
    attacker = Attack(certificate)
    size = (DRAWN, 3 * attacker.dof)
    corners = random.choice([-1.0, 1.0], size=size)
    ratios = attacker.largest(corners)
    found = {
        "corners": float(ratios.max()),
        "inside": float(attacker.largest(random.uniform(-1, 1, size=size)).max()),
        "climb": attacker.climb(corners[int(ratios.argmax())]),
    }
    if not attacker.shared:
        # With a shared dead time, not all combinations of joint positions are robots in the box.
        found["envelope"] = attacker.envelope(random)
    return found


def run(seed: int) -> Outcome:
    """Certify a job and attack the certificate."""
    try:
        certificate = certify(seed)
    except ac.NotRealizable:
        return Outcome(result="refused")
    found = attack(certificate, seed)
    kind = max(found, key=lambda x: found[x])
    notes = []
    if found[kind] > 1.0:
        notes.append(f"{kind}: {found[kind]:.5f} of the guaranteed error")
    return Outcome(result="certified", notes=notes, worst=found[kind])


class Attack:
    """Robots in a certificate's box, simulated by Runge-Kutta steps of 1 ms."""

    def __init__(self, certificate: ac.Certificate) -> None:
        self.arm = certificate.job.arm
        self.dof = self.arm.dof
        self.servo = certificate.job.plant_servo.for_joints(self.dof)
        self.half_widths = certificate.goal.box.half_widths(self.servo, self.dof)
        self.shared = certificate.goal.box.dead_time_shared
        self.set_points = certificate.set_points
        self.start = self.set_points.start_time
        alone = len(certificate.contours) == 1
        self.contours = []
        for x in certificate.contours:
            work = (-np.inf, np.inf) if alone else x.work
            self.contours.append(_Contour(x.path, work, x.budget.executed))

    def ratios(self, tool: FloatArray) -> FloatArray:
        """Return each robot's largest ratio of contour error to guarantee, (m,).

        `tool`: tool points of one motion, (m, dimension).
        """
        t = self.start + STEP * np.arange(len(tool))
        ratio = np.zeros(len(t))
        for x in self.contours:
            during = (t >= x.work[0]) & (t <= x.work[1])
            if during.any():
                ratio[during] = np.maximum(ratio[during], x.distance(tool[during]) / x.guaranteed)
        return ratio

    def positions(self, units: FloatArray) -> FloatArray:
        """Return joint positions over time, (m, n, dof), of robots in box units, (n, 3, dof)."""
        units = units.copy()
        if self.shared:
            units[:, 2] = units[:, 2, :1]
        kp = self.servo.kp * (1 + self.half_widths[0] * units[:, 0])
        kv = self.servo.kv * (1 + self.half_widths[1] * units[:, 1])
        delay = self.servo.dead_time + self.half_widths[2] * units[:, 2]
        t = self.set_points.start_time + self.set_points.cycle * np.arange(len(self.set_points.q))
        joints = np.arange(self.dof)

        def command(time: float) -> FloatArray:
            place = np.clip((time - delay - t[0]) / self.set_points.cycle, 0, len(t) - 1 - 1e-9)
            i = place.astype(int)
            share = place - i
            q = self.set_points.q
            return q[i, joints] * (1 - share) + q[i + 1, joints] * share

        # With p = v - lead u, q'' = kv (kp (u - q) + f u' - v) has no derivative of u, which jumps.
        lead = self.servo.velocity_feedforward * kv

        def rates(q: FloatArray, p: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
            v = p + lead * u
            return v, kv * (kp * (u - q) - v)

        h = STEP / 2
        q = np.tile(self.set_points.q[0], (len(units), 1))
        p = -lead * q
        results = [q]
        for k in range(int((t[-1] - t[0] + REST) / h)):
            u0, u1, u2 = (command(t[0] + (k + x) * h) for x in (0.0, 0.5, 1.0))
            v1, a1 = rates(q, p, u0)
            v2, a2 = rates(q + h / 2 * v1, p + h / 2 * a1, u1)
            v3, a3 = rates(q + h / 2 * v2, p + h / 2 * a2, u1)
            v4, a4 = rates(q + h * v3, p + h * a3, u2)
            q = q + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
            p = p + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            if k % 2:
                results.append(q)
        return np.array(results)

    def largest(self, units: FloatArray) -> FloatArray:
        """Return the largest ratio of each robot, (n,); `units`: in box units, (n, 3 dof)."""
        q = self.positions(units.reshape(-1, 3, self.dof))
        return np.array(
            [self.ratios(self.arm.tool_position(q[:, k])).max() for k in range(q.shape[1])]
        )

    def climb(self, signs: FloatArray) -> float:
        """Return the largest ratio from a corner, (3 dof,), changing one sign at a time."""
        best = float(self.largest(signs[None])[0])
        while True:
            neighbours = np.where(np.eye(signs.size, dtype=bool), -signs, signs)
            found = self.largest(neighbours)
            if found.max() <= best:
                return best
            best = float(found.max())
            signs = neighbours[int(found.argmax())]

    def envelope(self, random: np.random.Generator) -> float:
        """Return the largest ratio over the products of joint ranges, also inside of them."""
        units = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
        q = self.positions(np.repeat(units[:, :, None], self.dof, axis=2))
        low, high = q.min(axis=1), q.max(axis=1)
        motions = [np.where(x, high, low) for x in product((False, True), repeat=self.dof)]
        motions += [low + (high - low) * random.uniform(size=low.shape) for _ in range(20)]
        return max(float(self.ratios(self.arm.tool_position(x)).max()) for x in motions)


class _Contour:
    """A contour, the times at which its process is on, and the guaranteed distance [m]."""

    def __init__(self, path: ac.Path, work: tuple[float, float], guaranteed: float) -> None:
        self.work = work
        self.guaranteed = guaranteed
        self.points = path(np.linspace(0.0, path.length, SAMPLES))
        self.tree = cKDTree(self.points)

    def distance(self, tool: FloatArray) -> FloatArray:
        """Return the distances from tool points to the path, by short segments, (n,)."""
        _, nearest = self.tree.query(tool)
        best = np.full(len(tool), np.inf)
        for offset in (-1, 0):
            first = np.clip(nearest + offset, 0, len(self.points) - 2)
            start = self.points[first]
            along = self.points[first + 1] - start
            share = ((tool - start) * along).sum(axis=1) / (along * along).sum(axis=1)
            foot = start + np.clip(share, 0.0, 1.0)[:, None] * along
            best = np.minimum(best, np.linalg.norm(tool - foot, axis=1))
        return best
