"""Samples and trajectories compared with programs: contours found, rapids left out."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest

import armcontour as ac
from armcontour.program import Contour, Dwell, Lead, Process, Program, prepare

ARM = ac.load_arm("pmk3s")
LIMITS = ARM.limits.replace(speed=0.05, joint_acceleration=0.72)
SQUARE = ac.Path.polyline([[0.3, 0.1], [0.32, 0.1], [0.32, 0.12], [0.3, 0.12], [0.3, 0.1]])
LINE = ac.Path.polyline([[0.36, 0.16], [0.33, 0.16]])
DRAWN = Program(
    # The square twice: what follows it may be either.
    moves=(Contour(path=SQUARE), Contour(path=LINE), Dwell(duration=0.1), Contour(path=SQUARE))
)
PROGRAM = prepare(DRAWN, Process(begin="drawn", lead_in=Lead(length=4e-3)))


@dataclass
class Log:
    """Samples of positions only."""

    t: npt.ArrayLike
    q: npt.ArrayLike


@pytest.fixture(scope="module")
def planned():
    return ac.plan(PROGRAM, ARM, LIMITS)


def test_samples_and_trajectories_keep_to_a_program_but_in_rapids(planned):
    check = ac.check(planned.sample(4e-3), ARM, LIMITS, PROGRAM, deviation=1e-4)
    assert check.verdict == "kept"
    assert check.path_deviation is not None and check.path_deviation.distance < 1e-6
    # The tool is faster in rapids, where no speed is assigned.
    fastest = np.linalg.norm(
        ARM.tool_velocity(*(planned(np.arange(0, planned.duration, 4e-3), k) for k in (0, 1))),
        axis=1,
    ).max()
    assert fastest > 1.5 * 0.05
    assert check["speed"].ratio == pytest.approx(1.0, abs=1e-3)
    check = ac.check(planned, ARM, LIMITS, PROGRAM, deviation=1e-6, points=3)
    assert check.verdict == "kept"
    assert check.path_deviation is not None and check.path_deviation.distance < 1e-7


@pytest.mark.parametrize("contour", [0, 1, 2])
def test_a_deviation_is_found_on_its_contour(planned, contour):
    samples = planned.sample(4e-3)
    span = planned.contour_spans[contour]
    q = np.array(samples.q)
    # A bump in the middle of one contour; joint 1 turns the tool about the base by 0.3 m or more.
    inside = (samples.t - span.t[0]) / (span.t[1] - span.t[0])
    bump = 1e-3 * np.exp(-(((inside - 0.5) / 0.05) ** 2))
    q[:, 0] += bump
    moved = Log(samples.t, q)
    check = ac.check(moved, ARM, LIMITS, PROGRAM, deviation=1e-4)
    far = check.path_deviation
    assert far is not None and 1e-4 < far.distance < 1e-3
    assert check["path_deviation"].verdict == "violated"
    assert span.t[0] < far.t < span.t[1]
    assert span.s[0] <= far.s <= span.s[1]


def test_a_rapid_may_go_anywhere(planned):
    samples = planned.sample(4e-3)
    (begin, end) = next(x.t for x in planned.spans if x.kind == "rapid")
    inside = (samples.t - begin) / (end - begin)
    q = np.array(samples.q)
    q[:, 0] += 0.05 * np.exp(-(((inside - 0.5) / 0.1) ** 2))
    moved = Log(samples.t, q)
    check = ac.check(moved, ARM, LIMITS.replace(joint_acceleration=np.inf), PROGRAM, deviation=1e-4)
    assert check.verdict == "kept"


def test_what_does_not_follow_a_program_is_refused(planned, refuses):
    samples = planned.sample(4e-3)
    half = samples.t < planned.contour_spans[2].t[0] + 0.1
    cut = Log(samples.t[half], samples.q[half])
    refuses(
        lambda: ac.check(cut, ARM, LIMITS, PROGRAM), ac.InvalidInput, "contour 3", "whole program"
    )
    two = Program(moves=PROGRAM.moves[:3])
    refuses(lambda: ac.check(planned, ARM, LIMITS, two), ac.InvalidInput, "3 contours")
