"""Plants (simulated robots) that execute taught data; they share no formula with compensators."""

from armcontour.execution.plant import Plant, execute
from armcontour.execution.rigid_body_plant import RigidBodyPlant
from armcontour.execution.servo_plant import ServoPlant

__all__ = ["Plant", "RigidBodyPlant", "ServoPlant", "execute"]
