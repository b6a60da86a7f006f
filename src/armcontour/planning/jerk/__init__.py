"""Limits of jerk: the fastest timing whose accelerations are continuous."""
