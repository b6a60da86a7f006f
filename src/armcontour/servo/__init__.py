"""The joint servo as a linear model. Knows neither arm nor path."""

from armcontour.servo.model import INTERPOLATIONS, ORDERS, ServoModel

__all__ = ["INTERPOLATIONS", "ORDERS", "ServoModel"]
