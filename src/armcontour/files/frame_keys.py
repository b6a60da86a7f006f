"""Keys of a frame in a job file."""

from __future__ import annotations

from armcontour.core.frames import Frame, quaternions


def frame_keys(frame: Frame) -> dict[str, list[float]]:
    """Return the keys `position` [m] and `quaternion` of a frame in a job file."""
    # Rounding to 1 pm removes rounding errors, for example of 0.1 m. Adding zero converts -0 to 0.
    return {
        "position": (frame.position.round(12) + 0.0).tolist(),
        "quaternion": (quaternions(frame.rotation) + 0.0).tolist(),
    }
