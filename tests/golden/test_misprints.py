"""The paper's misprints and gaps: the printed form fails, and the corrected form is valid.

Source of every printed form: Munasinghe, Nakamura, Goto, Kyura, "Optimum Contouring of Industrial
Robot Arms Under Assigned Velocity and Torque Constraints", by its equation numbers. The table that
these tests prove is docs/method.md.
"""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

import armcontour as ac
from armcontour.paper.timing import run_laps

# Base offset and lengths of both links [m], Sec. IV-A.
L0 = 0.135
L1 = 0.250
L2 = 0.215
# Gains of the position and of the velocity loop [1/s], Sec. IV-A.
KP = 25.0
KV = 150.0
LIMIT = 0.72  # rad/s², Sec. IV-A
CORNER_ERROR = 5e-3  # m, Sec. IV-A
CENTRIPETAL = 0.09  # Sec. IV-A, printed in m/s
ASSIGNED = 0.15  # m/s, Sec. IV-A
# Sec. IV-A, s: P0 ... P9
STAMPS = np.array([0.000, 0.712, 1.182, 1.758, 2.294, 2.848, 3.344, 3.894, 4.490, 5.770])


@pytest.fixture(scope="module")
def planned(arm, rounded, limits):
    return ac.plan(rounded, arm, limits, ac.Paper())


def forward(theta1, theta2):
    """(1) and (2), which are printed right."""
    x = L0 + L1 * np.sin(theta1) + L2 * np.sin(theta1 + theta2)
    return np.array([x, L1 * np.cos(theta1) + L2 * np.cos(theta1 + theta2)])


def printed_inverse(x, y):
    """(3) and (4) as printed."""
    c = x - L0
    cosine = (L1**2 - L2**2 + c**2 + y**2) / (2 * L1 * np.sqrt(c**2 + y**2))
    theta1 = np.arctan(c / y) - np.arccos(cosine)
    theta2 = np.pi - np.arccos((L1**2 + L2**2 - c**2 - y**2) / (2 * L1 * L2))
    return theta1, theta2


class TestArm:
    def test_eq3_printed_arctangent_is_right_above_the_base_only(self, arm):
        above = (0.30, 0.20)
        below = (0.30, -0.20)
        assert_allclose(forward(*printed_inverse(*above)), above, atol=1e-12)
        assert np.linalg.norm(forward(*printed_inverse(*below)) - below) > 0.1
        assert_allclose(forward(*arm.joint_position(above)), above, atol=1e-12)
        assert_allclose(forward(*arm.joint_position(below)), below, atol=1e-12)

    def test_eq3_printed_arctangent_is_undefined_next_to_the_base(self, arm):
        beside = np.float64(0.30), np.float64(0.0)
        with np.errstate(all="raise"), pytest.raises((FloatingPointError, ZeroDivisionError)):
            printed_inverse(*beside)
        assert_allclose(forward(*arm.joint_position(beside)), beside, atol=1e-12)

    def test_eq4_printed_form_gives_only_one_of_two_configurations(self, arm):
        point = (0.30, 0.20)
        theta1, theta2 = printed_inverse(*point)
        other = arm.joint_position(point, configuration="negative")
        assert theta2 > 0
        assert_allclose(other[1], -theta2, atol=1e-12)
        # The other elbow needs its own theta1: a change of sign alone misses the point.
        assert np.linalg.norm(forward(theta1, -theta2) - point) > 0.1
        assert_allclose(forward(*other), point, atol=1e-12)


def printed_radius(error, alpha1, alpha2):
    """(11) as printed."""
    half = (alpha2 - alpha1) / 2
    return error * np.cos(half) / (1 - np.cos(half))


class TestCorners:
    def test_eq11_difference_of_headings_must_be_wrapped(self):
        alpha1, alpha2 = np.radians([170.0, -170.0])
        corner = np.array([np.cos(alpha1), np.sin(alpha1)])
        path = ac.Path.polyline([(0.0, 0.0), corner, corner + [np.cos(alpha2), np.sin(alpha2)]])
        assert printed_radius(CORNER_ERROR, alpha1, alpha2) < 0
        wrapped = np.radians(20.0)
        radius = ac.round_corners(path, tolerance=CORNER_ERROR).corners.radius[0]
        assert_allclose(radius, printed_radius(CORNER_ERROR, 0.0, wrapped), rtol=1e-9)
        assert_allclose(radius * (1 / np.cos(wrapped / 2) - 1), CORNER_ERROR, rtol=1e-9)

    def test_eq15_radius_needs_a_tangent_length_that_fits_the_lines(self):
        side = 0.01
        turn = np.pi / 2
        path = ac.Path.polyline([(0.0, 0.0), (side, 0.0), (side, side)])
        printed = printed_radius(CORNER_ERROR, 0.0, turn)
        assert printed * np.tan(turn / 2) > side
        corners = ac.round_corners(path, tolerance=CORNER_ERROR).corners
        assert corners.shrunk.all()
        assert corners.tangent[0] <= side * (1 + 1e-12)
        assert corners.error[0] < CORNER_ERROR

    def test_eq16_corner_speed_needs_the_assigned_velocity_as_a_bound(self, arm):
        path = ac.Path.polyline([(0.25, 0.25), (0.30, 0.25), (0.35, 0.2586)])
        rounded = ac.round_corners(path, tolerance=2e-4, acceleration=0.09)
        limits = arm.limits.replace(speed=0.03, centripetal_acceleration=0.09)
        assert rounded.corners.speed[0] > 0.03
        planned = ac.plan(rounded, arm, limits, ac.Paper())
        corner = next(x for x in planned.stretches if x.kind == "corner")
        assert_allclose(corner.speed, 0.03, rtol=1e-6)

    @pytest.mark.parametrize("turn", [1, -1])
    def test_eq17_printed_form_is_a_straight_line(self, turn):
        r = 0.01
        alpha1 = 0.7
        sweep = 1.2
        beta = np.linspace(0, sweep, 50)
        heading = np.array([np.cos(alpha1), np.sin(alpha1)])
        printed = r * np.sin(beta)[:, None] * heading
        # Every printed point is on the tangent through R, and none but R on the circle.
        normal = np.array([-heading[1], heading[0]])
        assert_allclose(printed @ normal, 0, atol=1e-17)
        centre = turn * r * normal
        assert (np.abs(np.linalg.norm(printed[1:] - centre, axis=1) - r) > 1e-7).all()
        x = r * (np.sin(beta) * np.cos(alpha1) - turn * (1 - np.cos(beta)) * np.sin(alpha1))
        y = r * (np.sin(beta) * np.sin(alpha1) + turn * (1 - np.cos(beta)) * np.cos(alpha1))
        mended = np.stack([x, y], axis=1)
        arc = ac.Path(segments=[ac.Arc(start=(0, 0), center=centre, angle=turn * sweep)])
        assert_allclose(np.linalg.norm(mended - centre, axis=1), r, rtol=1e-12)
        assert_allclose(arc(r * beta), mended, atol=1e-15)


def printed_lap_time(velocity, step, limit):
    """(18) as printed."""
    a = limit if step > 0 else -limit
    return (-velocity + np.sqrt(velocity**2 + 2 * a * step)) / (a * step)


def one_lap(velocity, step, limit=LIMIT):
    """Time and acceleration of one lap of one joint, by the library."""
    way = np.sign(step) or np.sign(velocity) or 1.0
    states = np.array([[0.0], [step]]), np.array([[way], [way]])
    h, _, _, acceleration, *_ = run_laps(*states, abs(velocity), np.array([limit]))
    return float(h[0]), float(acceleration[0, 0])


def step_after(velocity, acceleration, time):
    """Way of uniformly accelerated motion."""
    return velocity * time + acceleration * time**2 / 2


class TestLaps:
    def test_eq18_printed_denominator_has_an_extra_displacement(self):
        velocity = 0.2
        step = 0.01
        printed = printed_lap_time(velocity, step, LIMIT)
        assert step_after(velocity, LIMIT, printed) > 100 * step
        time, acceleration = one_lap(velocity, step)
        assert_allclose(acceleration, LIMIT, rtol=1e-9)
        assert_allclose(step_after(velocity, LIMIT, time), step, rtol=1e-12)
        assert_allclose(time, printed * step, rtol=1e-9)

    def test_eq18_printed_sign_of_the_root_gives_a_negative_time_backwards(self):
        velocity = -0.2
        step = -0.01
        plus = (-velocity + np.sqrt(velocity**2 + 2 * LIMIT * abs(step))) / -LIMIT
        assert plus < 0
        time, acceleration = one_lap(velocity, step)
        assert time > 0
        assert_allclose(acceleration, -LIMIT, rtol=1e-9)
        assert_allclose(step_after(velocity, -LIMIT, time), step, rtol=1e-12)

    def test_eq18_printed_time_is_undefined_for_a_joint_that_returns(self):
        velocity = 0.2
        with np.errstate(all="raise"), pytest.raises(FloatingPointError):
            printed_lap_time(np.float64(velocity), np.float64(0.0), LIMIT)
        time, acceleration = one_lap(velocity, 0.0)
        assert_allclose(time, 2 * velocity / LIMIT, rtol=1e-12)
        assert_allclose(step_after(velocity, acceleration, time), 0, atol=1e-15)

    def test_eq19_largest_of_the_smallest_times_can_break_a_limit(self):
        limit = 1.0
        velocity = 1.0
        step = 0.1
        assert velocity**2 > 2 * limit * step  # joint 1 cannot stop within its lap
        time_alone = one_lap(velocity, step, limit)[0]
        slower = one_lap(0.0, 0.5, limit)[0]
        printed = max(time_alone, slower)
        assert abs(2 * (step - velocity * printed) / printed**2) > limit
        root = np.sqrt(velocity**2 - 2 * limit * step)
        for time, feasible in (
            ((velocity - root) / limit * (1 - 1e-6), True),
            ((velocity - root) / limit * (1 + 1e-6), False),
            ((velocity + root) / limit * (1 - 1e-6), False),
            ((velocity + root) / limit * (1 + 1e-6), True),
        ):
            needed = abs(2 * (step - velocity * time) / time**2)
            assert bool(needed <= limit) is feasible
        # The library stops there, and names the joint and what it would need.
        states = np.array([[0.0, 0.0], [step, 0.5]]), np.array([[velocity, 0.0], [velocity, 1.0]])
        *_, laps_done, joint, needed = run_laps(*states, 1.0, np.array([limit, limit]))
        assert (laps_done, joint) == (0, 0)
        assert_allclose(needed, 1.8, rtol=1e-12)

    def test_eq19_line_on_which_a_joint_reverses_is_refused(self, arm):
        line = ac.Path.polyline([(-0.065, 0.300), (0.335, 0.300)])
        limits = arm.limits.replace(speed=0.3)
        with pytest.raises(ac.NotRealizable) as caught:
            ac.plan(line, arm, limits, ac.Paper(knots=1000))
        assert caught.value.joint == 1
        assert caught.value.needed > LIMIT
        assert 0.12 < caught.value.s < 0.14  # before the joint turns round at 0.200 m

    def test_eq18_text_calls_an_acceleration_a_velocity(self):
        time, acceleration = one_lap(0.2, 0.01)
        faster_time, faster = one_lap(0.4, 0.01, 4 * LIMIT)
        # With the clock twice as fast a velocity doubles; what the text names quadruples.
        assert_allclose(faster_time, time / 2, rtol=1e-12)
        assert not np.isclose(faster, 2 * acceleration)
        assert_allclose(faster, 4 * acceleration, rtol=1e-12)

    def test_eq20_printed_division_by_h_misses_the_knot(self):
        velocity = 0.2
        step = 0.01
        time, acceleration = one_lap(velocity, step, LIMIT / 2)
        printed = 2 * (step - velocity * time) / time
        mended = 2 * (step - velocity * time) / time**2
        assert abs(step_after(velocity, printed, time) - step) > 0.01 * step
        assert_allclose(step_after(velocity, mended, time), step, rtol=1e-12)
        assert_allclose(acceleration, mended, rtol=1e-9)

    def test_eq21_time_runs_from_the_start_of_the_lap(self, arm, rounded, planned):
        law = planned.laws[0]
        k = len(law.breaks) // 2
        begin = law.breaks[k]
        end = law.breaks[k + 1]
        state = planned(begin), planned(begin, 1), planned(begin, 2)
        place = arm.joint_position(
            rounded([rounded.project(arm.tool_position(law.q[k + 1])[None]).s[0]])
        )[0]
        printed = state[0] + state[1] * end + state[2] * end**2 / 2
        mended = state[0] + state[1] * (end - begin) + state[2] * (end - begin) ** 2 / 2
        assert np.abs(printed - place).max() > 0.01
        assert_allclose(mended, place, atol=1e-8)
        assert_allclose(planned(end), place, atol=1e-8)

    def test_eq21_passing_on_the_end_velocity_alternates_undamped(self, arm, rounded):
        knots = arm.joint_position(rounded(np.linspace(0, rounded.breaks[1], 201)))
        exact, plain = plain_laps(knots)
        joint_path = ac.trace(rounded, arm)
        slopes = joint_path(np.linspace(0, rounded.breaks[1] * (1 - 1e-15), 201), 1)
        _, _, _, shipped, laps_done, *_ = run_laps(knots, slopes, 0.0, np.array([LIMIT, LIMIT]))

        def zigzag(acceleration):
            """Largest second difference of joint 1, which does not set the laps' times."""
            return np.abs(np.diff(acceleration[100:, 0], 2)).max()

        assert laps_done == 200
        # The differences change sign at every lap: +, -, +, -.
        assert (np.diff(np.sign(np.diff(plain[100:, 0]))) != 0).all()
        assert zigzag(plain) > 0.05
        assert zigzag(shipped) < 1e-3
        error = 1e-5
        wrong, _ = plain_laps(knots, np.array([error, 0.0]))
        assert_allclose((wrong - exact)[1:, 0], error * (-1.0) ** np.arange(1, 201), rtol=1e-3)

    def test_eq21_velocities_of_the_library_fit_at_the_knots_to_second_order(self, arm, rounded):
        joint_path = ac.trace(rounded, arm)
        gaps = []
        for count in (100, 200, 400):
            s = np.linspace(0, rounded.breaks[1] * (1 - 1e-15), count + 1)
            states = joint_path(s), joint_path(s, 1)
            h, _, begin, acceleration, *_ = run_laps(*states, 0.01, np.array([LIMIT, LIMIT]))
            end = begin + acceleration * h[:, None]
            jumps = np.abs(end[:-1] - begin[1:])
            assert jumps[:, 1].max() < 1e-15  # joint 2 sets the laps' times
            gaps.append(jumps[count // 2, 0])
        assert gaps[0] < 1e-5  # rad/s
        assert_allclose([gaps[0] / gaps[1], gaps[1] / gaps[2]], 4.0, rtol=0.05)


def plain_laps(knots, velocity=(0.0, 0.0)):
    """Mended (18) to (20), with `dq + ddq h` as the velocity of the next lap."""
    velocity = np.array(velocity, dtype=float)
    velocities = [velocity]
    accelerations = []
    for step in np.diff(knots, axis=0):
        towards = velocity * np.sign(step)
        times = (-towards + np.sqrt(towards**2 + 2 * LIMIT * np.abs(step))) / LIMIT
        h = times.max()
        accelerations.append(2 * (step - velocity * h) / h**2)
        velocity = velocity + accelerations[-1] * h
        velocities.append(velocity)
    return np.array(velocities), np.array(accelerations)


class TestMiddlePath:
    # Start and end [m]: the path goes to the left and up, like line 2.
    p1 = np.array([0.36, 0.20])
    p2 = np.array([0.30, 0.27])
    # Speeds at the start and at the end [m/s]: the tool slows down.
    v_f = 0.148
    v_r = 0.140

    def test_eq24_eq25_need_the_unit_vector_and_the_signed_acceleration(self):
        chord = self.p2 - self.p1
        length = np.linalg.norm(chord)
        along = chord / length
        phi = np.arcsin(chord[1] / length)
        time = 2 * length / (self.v_f + self.v_r)
        signed = (self.v_r - self.v_f) / time

        def end(direction, acceleration):
            return self.p1 + along * self.v_f * time + direction * acceleration * time**2 / 2

        direction = np.array([np.cos(phi), np.sin(phi)])
        assert_allclose(abs(direction), abs(along), rtol=1e-12)
        printed = end(direction, abs(signed))
        only_quadrant = end(along, abs(signed))
        assert np.linalg.norm(printed - self.p2) > 1e-3
        assert np.linalg.norm(only_quadrant - self.p2) > 1e-3
        assert_allclose(end(along, signed), self.p2, atol=1e-15)

    def test_eq24_library_moves_the_tool_with_uniform_acceleration(self, arm, planned):
        middle = next(x for x in planned.stretches if x.kind == "AVC")
        t = np.linspace(*middle.t, 41)[1:-1]
        q = planned(t)
        dq = planned(t, 1)
        ddq = planned(t, 2)
        ends = arm.tool_position(planned(np.array(middle.t)))
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        v_f = np.linalg.norm(arm.tool_velocity(q, dq)[0])
        v_r = np.linalg.norm(arm.tool_velocity(q, dq)[-1])
        expected = (v_r - v_f) / (t[-1] - t[0]) * along
        acceleration = arm.tool_acceleration(q, dq, ddq)
        assert_allclose(acceleration, np.tile(expected, (len(t), 1)), atol=2e-4)
        # T is the time of line 2 (MAC, AVC, MDC), not of the whole job.
        before, uniform, after = np.diff(STAMPS)[3:6]
        assert_allclose(STAMPS[6] - STAMPS[3] - after - before, uniform, atol=1e-12)
        assert STAMPS[-1] - after - before > 8 * uniform


def printed_compensator(m1, m2, g):
    """Numerator and denominator of (26) as printed, the leading minus included."""
    a0 = -m1 * m2 * g
    x = (KV + g) * (m1 + m2) + KV**2 + m1 * m2 + KV * g
    a1 = x - m1 * m2 * g / KP
    a2 = x / KP - m1 * m2 * g / (KP * KV)
    a3 = x / (KP * KV)
    return -np.array([a3, a2, a1, a0]), np.poly([m1, m2, g])


class TestCompensator:
    poles = (-150.0, -150.0, -150.0)

    def test_eq26_without_the_minus_equals_pole_placement(self, planned):
        servo = ac.ServoModel(kp=KP, kv=KV)
        free = dataclasses.replace(planned, limits=None)
        set_points = ac.compensate(free, servo, ac.PolePlacement(poles=self.poles), cycle=4e-3)
        t = np.arange(0, set_points.t[-1], 1e-4)
        start = planned(0.0)
        moved = planned(np.minimum(t, planned.duration)) - start
        numerator, denominator = printed_compensator(*self.poles)
        assert_allclose(numerator[-1] / denominator[-1], -1.0, rtol=1e-12)
        for j in range(2):
            _, printed, _ = signal.lsim((numerator, denominator), moved[:, j], t)
            ours = set_points.q[:-1, j] - start[j]
            printed_q = np.interp(set_points.t[:-1], t, printed)
            assert_allclose(-printed_q, ours, atol=2e-6)
            assert np.abs(printed_q - ours).max() > 0.1

    @pytest.mark.parametrize("poles", [(-150.0, -150.0, -150.0), (-60.0, -100.0, -40.0)])
    def test_eq26_corrected_numerator_has_the_factor_of_the_servo(self, poles):
        m1, m2, g = poles
        numerator, denominator = printed_compensator(*poles)
        # Unless g is -KV, no zero cancels a pole, so that the order is three and not two.
        distances = np.abs(np.roots(numerator)[:, None] - poles)
        assert len(denominator) == 4 and (g == -KV or distances.min() > 1)
        x = (KV + g) * (m1 + m2) + KV**2 + m1 * m2 + KV * g
        inverse = [1 / (KP * KV), 1 / KP, 1.0]
        assert_allclose(-numerator, np.polymul(inverse, [x, -m1 * m2 * g]), rtol=1e-12)


def printed_eq27(theta1, theta2, rate1, rate2):
    """The matrices P and Q of (27) as printed."""
    s1, c1 = np.sin(theta1), np.cos(theta1)
    s2, c2 = np.sin(theta2), np.cos(theta2)
    s12, c12 = np.sin(theta1 + theta2), np.cos(theta1 + theta2)
    d = L1 * L2 * s2
    p11 = s12 / (L1 * s2)
    p12 = c12 / (L1 * s2)
    p21 = -(L1 * s1 + L2 * s12) / d
    p22 = (-L1 * c1 + L2 * c12) / d
    q11 = c12 / (L1 * s2) * rate1 - s1 / (L1 * s2**2) * rate2
    q12 = -(s12 / (L1 * s2) * rate1 + c1 / (L1 * s2**2) * rate2)
    q21 = -(L1 * c1 + L2 * c12) / d * rate1 + s1 * (L2 + L1 * c2) / (d * s2) * rate2
    q22 = (L1 * s1 + L2 * s12) / d * rate1 + c1 * (L2 + L1 * c2) / d * rate2
    return np.array([[p11, p12], [p21, p22]]), np.array([[q11, q12], [q21, q22]])


class TestMiddlePathAcceleration:
    theta = np.array([0.31, 1.27])  # rad
    rate = np.array([0.4, -0.7])  # rad/s
    acceleration = np.array([0.15, 0.35])  # rad/s²

    def tool_motion(self):
        """Tool velocity and acceleration by differences of (1) and (2)."""

        def tool(t):
            return forward(*(self.theta + self.rate * t + self.acceleration * t**2 / 2))

        d = 1e-4
        return (tool(d) - tool(-d)) / (2 * d), (tool(d) - 2 * tool(0.0) + tool(-d)) / d**2

    def matrices(self, **mended):
        p, q = printed_eq27(*self.theta, *self.rate)
        x, y = forward(*self.theta) - [L0, 0]
        s2 = np.sin(self.theta[1])
        if mended.get("p22"):
            p[1, 1] = -y / (L1 * L2 * s2)
        if mended.get("q22"):
            square = np.cos(self.theta[0]) * (L2 + L1 * np.cos(self.theta[1])) / (L1 * L2 * s2**2)
            q[1, 1] = x / (L1 * L2 * s2) * self.rate[0] + square * self.rate[1]
        return p, q

    def joint_acceleration(self, **mended):
        p, q = self.matrices(**mended)
        velocity, acceleration = self.tool_motion()
        return p @ acceleration + q @ velocity

    def test_eq27_p22_needs_a_bracket(self, arm):
        p, _ = self.matrices()
        inverse = np.linalg.inv(arm.tool_jacobian(self.theta))
        assert_allclose(p.ravel()[:3], inverse.ravel()[:3], rtol=1e-12)
        assert not np.isclose(p[1, 1], inverse[1, 1])
        assert_allclose(self.matrices(p22=True)[0], inverse, rtol=1e-12)

    def test_eq27_q22_needs_a_square(self, arm):
        _, q = self.matrices()
        inverse = np.linalg.inv(arm.tool_jacobian(self.theta))
        rate = -inverse @ arm.tool_jacobian_rate(self.theta, self.rate) @ inverse
        assert_allclose(q.ravel()[:3], rate.ravel()[:3], rtol=1e-12)
        assert not np.isclose(q[1, 1], rate[1, 1])
        assert_allclose(self.matrices(q22=True)[1], rate, rtol=1e-12)

    def test_eq27_gives_the_joint_acceleration_with_bracket_and_square(self, arm):
        for mended in ({}, {"p22": True}, {"q22": True}):
            assert np.abs(self.joint_acceleration(**mended) - self.acceleration).max() > 0.005
        acceleration = self.joint_acceleration(p22=True, q22=True)
        assert_allclose(acceleration, self.acceleration, atol=1e-6)
        library = arm.joint_acceleration(self.theta, self.rate, self.tool_motion()[1])
        assert_allclose(library, self.acceleration, atol=1e-6)


class TestJob:
    def test_sec3_has_no_rule_for_passes_that_meet_below_the_assigned_velocity(self, planned):
        for name in ("line 1", "line 3"):
            parts = [x for x in planned.stretches if x.name == name]
            # No place of the line has v = v_a, so (24) has no P1 and no P2 to start from.
            assert max(x.speed for x in parts) < 0.7 * ASSIGNED
            assert [x.kind for x in parts] == ["MAC", "MDC"]

    def test_sec4_acceleration_bound_is_an_acceleration(self, rounded, planned):
        corners = rounded.corners
        stamps = np.diff(STAMPS)[[2, 6]]  # P2 P3 and P6 P7
        way = corners.radius * corners.turn
        as_speed = way / CENTRIPETAL
        as_acceleration = way / np.sqrt(CENTRIPETAL * corners.radius)
        assert (as_speed < 0.5 * stamps).all()
        assert_allclose(as_acceleration, stamps, rtol=0.03)
        ours = [x.t[1] - x.t[0] for x in planned.stretches if x.kind == "corner"]
        assert_allclose(ours, as_acceleration, rtol=1e-9)

    def test_table1_contradicts_the_time_stamps(self, planned):
        assert round(100 * 0.164 / 2.630, 1) == 6.2  # Table I, mm; printed as 6.3 %
        table = 5.600  # s, Table I, proposed (simulation)
        assert STAMPS[-1] - table > 0.1
        # All of it, and more, is in the last stretch: ours are the paper's up to P8.
        assert_allclose(np.diff(planned.switching_points)[:8], np.diff(STAMPS)[:8], atol=0.06)
        assert np.diff(STAMPS)[8] - np.diff(planned.switching_points)[8] > 0.4
        assert_allclose(planned.switching_points[-1], planned.duration, rtol=1e-12)
