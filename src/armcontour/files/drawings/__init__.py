"""Readers for drawings (DXF, SVG), G-code and tables of waypoints; each returns a `Program`."""
