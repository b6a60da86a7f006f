"""Model and simulation of the joint servos, without arm and path."""

from armcontour.robot.servo.model import INTERPOLATIONS, ORDERS, ServoModel

__all__ = ["INTERPOLATIONS", "ORDERS", "ServoModel"]
