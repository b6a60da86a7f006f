"""Speed limits of the slow move with which a robot program reaches its first set-point."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowMove:
    """Speed limits of the move to the first set-point.

    Each program format uses those it can express.

    Formats without a program (csv, ros-yaml) have no move to the start.
    """

    # Joints of the arm and external axes in KRL, which knows only percent of the largest speed of
    # each axis [%].
    percent: int = 10
    # The joint that moves most, in URScript [rad/s], and its acceleration [rad/s²].
    joint_speed: float = 0.2
    joint_acceleration: float = 0.3
    # The tool, in RAPID [mm/s], and its rotation [deg/s].
    tool: int = 50
    tool_rotation: int = 10
    # Linear external axes in RAPID [mm/s], and rotating ones [deg/s].
    external_linear: int = 50
    external_rotation: int = 10


SLOW = SlowMove()
