"""Plants (simulated robots) that execute taught data; they share no formula with compensators."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "plant": "Plant ServoPlant execute",
    "rigid_body_plant": "RigidBodyPlant",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
