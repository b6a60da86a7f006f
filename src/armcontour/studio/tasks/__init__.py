"""Tasks of the task process: exact figures, files, logs.

A task takes a `Request` and returns a message frame. A frame with a file has the array `content`,
and `name` and `type` in its header.
"""
