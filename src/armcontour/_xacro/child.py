"""The process that expands one xacro file: started as a script, it answers once and ends.

It reads one line of JSON from its input, and writes one to its output. It ends when its input ends,
which the end of its parent brings about, and when its time is over.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import sys
import threading
from collections.abc import Mapping
from typing import Any

# Frames of Python per macro are some 10, with the elements around its call.
DEEPEST = 5000
MEGABYTE = 1_000_000


def main() -> None:
    """Answer one request, and end."""
    request = json.loads(sys.stdin.buffer.readline())
    # This watch runs outside of the interpreter: no expression can keep it from ending the process.
    nowhere = open(os.devnull, "w")
    faulthandler.dump_traceback_later(request["seconds"] + 1, exit=True, file=nowhere)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # Folders that the parent imports from, but for that of the description.
    sys.path[:] = request["path"]
    answer = json.dumps(_answer(request)).encode()
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.buffer.write(answer)
        sys.stdout.buffer.flush()
    os._exit(0)


def _end_with_parent() -> None:
    while os.read(0, 1):
        pass
    os._exit(1)


def _answer(request: Mapping[str, Any]) -> dict[str, str]:
    """What the description expands to, or why it is refused."""
    from armcontour._xacro.expressions import Refused

    try:
        return {"text": _expand(request)}
    except Refused as error:
        return {"refused": str(error)}
    except MemoryError:
        return {"refused": f"it needs more memory than {request['megabytes']} MB"}
    # Expressions of the file may fail in any way.
    except Exception as error:
        return {"failed": _said(error)}


def _expand(request: Mapping[str, Any]) -> str:
    """The text that a description expands to."""
    import xml.dom.expatbuilder  # noqa: F401

    import xacro
    import yaml  # noqa: F401
    from xacro import substitution_args

    from armcontour._xacro import guard
    from armcontour._xacro.expressions import Refused

    # Without ROS there is none, and then no package is found.
    with contextlib.suppress(ImportError):
        import ament_index_python.packages  # type: ignore[import-not-found]  # noqa: F401
    file = request["file"]
    reading = guard.Reading(file)
    guard.guard(xacro, substitution_args, reading)
    xacro.verbosity = 0
    sys.setrecursionlimit(DEEPEST)
    _limit(request)
    guard.watch(reading)
    found = str(xacro.process_file(file, verbosity=0).toxml())
    if len(found) > request["most"]:
        raise Refused(f"it expands to more than {request['most'] / MEGABYTE:.0f} MB")
    return found


def _limit(request: Mapping[str, Any]) -> None:
    """Limit memory, time, files and processes, where the system can."""
    try:
        import resource
    except ImportError:
        return
    seconds = int(request["seconds"]) + 2
    memory = request["megabytes"] * MEGABYTE
    for name, most in (
        ("RLIMIT_AS", memory),
        ("RLIMIT_CPU", seconds),
        ("RLIMIT_FSIZE", 0),
        ("RLIMIT_CORE", 0),
        ("RLIMIT_NPROC", 0),
    ):
        # Some systems know fewer limits, or do not take this one.
        with contextlib.suppress(AttributeError, ValueError, OSError):
            resource.setrlimit(getattr(resource, name), (most, most))


def _said(error: BaseException) -> str:
    """What an error says; of one that wraps others, too deep a nesting goes first."""
    inner: BaseException | None = error
    while inner is not None:
        if isinstance(inner, RecursionError):
            return "it is nested too deeply"
        if isinstance(inner, MemoryError):
            return "it needs more memory than there is for it"
        inner = getattr(inner, "exc", None)
    return " ".join(str(error).split()) or type(error).__name__


if __name__ == "__main__":
    main()
