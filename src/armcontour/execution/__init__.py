"""Plants (simulated robots) that execute taught data; they share no formula with compensators."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.execution.plant import Plant, ServoPlant, execute
    from armcontour.execution.rigid_body_plant import RigidBodyPlant
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "plant": "Plant ServoPlant execute",
            "rigid_body_plant": "RigidBodyPlant",
        },
    )
