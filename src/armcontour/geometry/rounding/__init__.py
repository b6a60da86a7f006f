"""Rounding of corners, smoothing of the curvature, and repair of almost tangent vertices."""
