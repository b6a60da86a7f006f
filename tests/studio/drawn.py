"""Frames as the page gets them, and points as it draws them."""

from armcontour.studio.wire import Frame


def packed(frame):
    """What the page gets."""
    return Frame.unpack(frame.pack())


def uv(view, points):
    """Points in the plane by hand: this one is that of x and y."""
    return points[..., :2] - view.plane.origin[:2]
