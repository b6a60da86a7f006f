"""Readers of what users have: drawings, G-code, tables of waypoints; each gives a `Program`."""
