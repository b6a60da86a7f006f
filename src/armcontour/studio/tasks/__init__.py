"""What takes longer than a preview: exact figures, checks, searches, files; in another process.

A request is a mapping of `text`, `source`, `folder`, `run` and `trust_xacro`, which are the
document and its run, and of `options`, which are those of the task. A result is a frame: its header
has the facts, and a file is an array `content` of bytes, with its `name` and `type` in the header.
"""
