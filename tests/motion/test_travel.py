"""Bounds of how far joints move."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.motion import Law
from armcontour.motion.travel import fastest_joints, joint_travel

ARM = ac.load_arm("pmk3s")
PATH = ac.round_corners(ac.Path.polyline([[0.35, 0.1], [0.41, 0.15], [0.28, 0.3]]), tolerance=0.005)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"method": "mac", "limits": ARM.limits.replace(centripetal_acceleration=0.09)},
        {"method": "conventional"},
        {"smoothing": (0.05,), "reserve": 0.3},
        {"smoothing": (0.05, 0.02), "reserve": 0.3},
        {"limits": ARM.limits.replace(joint_jerk=50.0)},
    ],
)
@pytest.mark.filterwarnings("ignore:Limits of jerk add")
def test_no_joint_moves_farther_than_its_bound(options: dict) -> None:
    limits = options.pop("limits", ARM.limits).replace(speed=0.1)
    path = PATH
    if options.get("method") == "conventional":
        path = ac.Path.polyline([[0.35, 0.1], [0.41, 0.15]])
    motion = ac.plan(path, ARM, limits, **options)
    t, travel = joint_travel(motion)
    assert t[0] == 0.0 and t[-1] == pytest.approx(motion.duration)
    dense = np.linspace(0.0, motion.duration, 20_001)
    moved = np.abs(np.diff(motion(dense), axis=0))
    bound = np.stack([np.interp(dense, t, x) for x in travel.T], axis=1)
    assert (moved <= np.diff(bound, axis=0) + 1e-12).all()
    # The bound is useful: not more than twice the true way.
    assert (travel[-1] < 2 * moved.sum(axis=0)).all()


def test_an_executed_motion_has_bounds_too() -> None:
    taught = ac.compensate(
        ac.plan(PATH, ARM, ARM.limits.replace(speed=0.1)),
        ac.ServoModel(kp=25.0, kv=150.0),
        method="inverse",
        period=0.004,
        arm=ARM,
    )
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    plant = ac.ServoPlant(ARM, servo, ARM.limits)
    coarse = ac.execute(taught, plant, resolution=4)
    fine = ac.execute(taught, plant, resolution=32)
    t, travel = joint_travel(coarse)
    bound = np.stack([np.interp(fine.t, t, x) for x in travel.T], axis=1)
    assert (np.abs(np.diff(fine.q, axis=0)) <= np.diff(bound, axis=0) + 1e-12).all()


def test_a_law_of_another_kind_is_refused() -> None:
    class Own(Law):
        """A law of a user."""

        breaks = np.array([0.0, 1.0])

        def on_interval(self, i, t, order):
            return np.zeros((len(t), 2))

    with pytest.raises(
        InvalidInput, match="no bound of joint velocities for a law of the kind Own"
    ):
        fastest_joints(Own())
