"""Plants (simulated robots) that execute taught data; they share no formula with compensators."""

from armcontour.execution.plant import Plant, ServoPlant, execute
from armcontour.execution.rigid_body_plant import RigidBodyPlant

__all__ = ["Plant", "RigidBodyPlant", "ServoPlant", "execute"]
