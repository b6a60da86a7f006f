"""Plants that execute taught data. They share no formula with the compensators."""

from armcontour.execution.plant import Plant, execute
from armcontour.execution.rigid_body_plant import RigidBodyPlant
from armcontour.execution.servo_plant import ServoPlant

__all__ = ["Plant", "RigidBodyPlant", "ServoPlant", "execute"]
