"""Tasks of the task process: exact figures, checks, searches, files.

A task maps a `Request` to a frame. A file is the array `content`, its header has `name` and `type`.
"""
