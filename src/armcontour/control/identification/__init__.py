"""Identification of independent joint servos from logs.

`identify` in `servo_identification` checks the logs, identifies each joint, and judges the result:

1. `joint_identification` identifies one joint. It divides logs into segments (`log_segments`),
   excludes saturated samples (`saturation`, `saturated_selection`), and selects a model
   (`model_selection`) by its errors on parts to which it was not fitted (`cross_validation`).
2. `joint_fit` fits a model to segments, `parameter_estimates` computes intervals.
3. `contour_judgement` chooses which models are written, by the contour error in each log
   (`contour_comparison`).
"""

from armcontour.core.lazy import lazy_names

_HOME = {
    "estimate": "Estimate",
    "identification_result": "Identification JointIdentification Judgement Prediction",
    "servo_identification": "ServoFit identify",
    "armcontour.motion.log": "INTERPOLATIONS Log cut_log",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
