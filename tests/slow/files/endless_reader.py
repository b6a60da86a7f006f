"""A reader for `read_in_process` that leaves a trace, and then works, waits or grows."""

import os
import time
from pathlib import Path


def answer(question, folder):
    trace, what = question
    (folder / "unpacked").write_bytes(b"x")
    if trace is not None:
        Path(trace).write_text(f"{os.getpid()} {folder}\n")
    grown = []
    while what != "answer":
        if what == "wait":
            time.sleep(0.1)
        if what == "grow":
            grown.append(bytes(10_000_000))
        if what == "fail":
            raise LookupError
    print("a library writes to the standard output")
    return [str(folder), what]
