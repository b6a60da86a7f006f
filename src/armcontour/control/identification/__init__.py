"""Identification of independent joint servos from logs."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "estimate": "Estimate",
    "identification_result": "Identification JointIdentification Judgement Prediction",
    "servo_identification": "ServoFit identify",
    "armcontour.motion.log": "INTERPOLATIONS Log cut_log",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
