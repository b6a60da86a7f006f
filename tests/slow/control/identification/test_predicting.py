"""A servo model of six axes of a real robot."""

from pathlib import Path

import numpy as np

import armcontour as ac
from armcontour.files.log_file import read_log
from armcontour.robot import Chain

KR300 = Path(__file__).parents[3] / "control" / "identification" / "kuka_kr300"
# Axes 1 to 3 with the centre of the wrist as tool, in the order of size of a KR300 [m].
PLAIN = ac.Frame().rotation
BASE = ac.SerialArm(
    name="three axes",
    chain=Chain(
        joints=("a1", "a2", "a3"),
        positions=[(0, 0, 0.675), (0.35, 0, 0), (1.15, 0, 0)],
        rotations=[PLAIN] * 3,
        axes=[(0, 0, 1), (0, 1, 0), (0, 1, 0)],
        tip=ac.Frame(position=(1.24, 0, -0.041)),
    ),
    limits=ac.Limits(),
)


def contour_error(log, rest, use):
    """RMS distance of the tool to its commanded path, without constant offsets [m]."""
    path, moved = (
        BASE.tool_position(x[:, :3])
        for x in (log.command, log.command + rest - rest[use].mean(axis=0))
    )
    fine = np.linspace(0, len(path) - 1, 20 * len(path) - 19)
    dense = np.stack([np.interp(fine, np.arange(len(path)), x) for x in path.T], axis=1)
    away = [
        np.linalg.norm(dense[max(20 * i - 500, 0) : 20 * i + 500] - moved[i], axis=1).min()
        for i in np.flatnonzero(use)
    ]
    return np.sqrt(np.mean(np.square(away)))


def test_a_real_robot_is_predicted_or_its_model_is_marked_doubtful():
    """KUKA KR300, programs A and B, both multisines (see its LICENSE)."""
    logs = [read_log(KR300 / f"{x}.csv") for x in "AB"]
    both = ac.identify(logs)
    good = np.array([x.written and not x.note for x in both.joints])
    assert good[[0, 3]].all() and not good[1:3].any()
    for log in logs:
        prediction = both.predict(log)
        assert (prediction.rms <= 0.3 * prediction.tracking_rms)[good].all()
    # Weak models of other axes are written: without gravity the contour is better than without.
    assert both.judgement.programs == 2 and both.judgement.ratio < 0.7
    assert both.servo_model().doubt
    for log, other in (logs, logs[::-1]):
        one = ac.identify(log)
        prediction = one.predict(other)
        # From one program: never worse than no model on the other one, at joints and at the tool.
        assert (prediction.rms <= prediction.tracking_rms * (1 + 1e-9)).all()
        use = prediction.used.all(axis=1)
        lag = other.measured - other.command
        ratio = contour_error(other, prediction.errors, use) / contour_error(other, lag, use)
        assert ratio < 0.7 and one.judgement.programs == 1 and one.servo_model().doubt
