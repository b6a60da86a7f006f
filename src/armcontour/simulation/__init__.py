"""Plants: simulated robots that execute set-points, independent of the compensators' formulas."""

from armcontour.core.lazy import lazy_names

_HOME = {"plant": "Plant ServoPlant simulate", "rigid_body_plant": "RigidBodyPlant"}
__getattr__, __all__ = lazy_names(__name__, _HOME)
