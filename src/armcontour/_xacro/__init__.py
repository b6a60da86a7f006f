"""Expansion of xacro files, which contain programs, in a guarded process of its own.

The guards are defence in depth, not a security boundary: only trusted files are expanded.
"""
