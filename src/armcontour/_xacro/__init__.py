"""Xacro files are programs: they are expanded in a guarded process of their own.

The guards are defence in depth, not a boundary: only files that somebody trusts are expanded.
"""
