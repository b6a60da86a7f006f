"""The child process that expands one xacro file; it is started as a script.

The process reads one line of JSON from its standard input and writes one to its standard output.
It ends early when its input is closed, for example by the end of the parent, or at the time limit.
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

# Recursion limit of Python: a macro takes about 10 frames with the elements around its call.
DEEPEST = 5000
MEGABYTE = 1_000_000


def main() -> None:
    """Answer one request, then end the process."""
    request = json.loads(sys.stdin.buffer.readline())
    # This timer runs outside of the interpreter, so no expression can prevent it from ending the
    # process.
    nowhere = open(os.devnull, "w")
    faulthandler.dump_traceback_later(request["seconds"] + 1, exit=True, file=nowhere)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # The parent's import path without the folder of the description.
    sys.path[:] = request["path"]
    answer = json.dumps(_answer(request)).encode()
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.buffer.write(answer)
        sys.stdout.buffer.flush()
    os._exit(0)


def _end_with_parent() -> None:
    """End the process when its standard input is closed."""
    while os.read(0, 1):
        pass
    os._exit(1)


def _answer(request: Mapping[str, Any]) -> dict[str, str]:
    """The expanded description ("text"), or why there is none ("lacking", "refused", "failed")."""
    from armcontour._xacro.expressions import Lacking, Refused

    try:
        return {"text": _expand(request)}
    except Lacking as error:
        return {"lacking": str(error)}
    except Refused as error:
        return {"refused": str(error)}
    except MemoryError:
        return {"refused": f"it needs more memory than {request['megabytes']} MB"}
    # Expressions of the file may raise any exception.
    except Exception as error:
        return {"failed": _message(error)}


def _expand(request: Mapping[str, Any]) -> str:
    """The expanded text of a description.

    Raises:
        Lacking: A package or an argument is lacking, or the description has no such argument.
        Refused: The description does something that is refused, or expands to too much text.
    """
    import xml.dom.expatbuilder  # noqa: F401

    import xacro
    import yaml  # noqa: F401
    from xacro import substitution_args

    from armcontour._xacro import guard
    from armcontour._xacro.expressions import Refused

    # Without ROS this module does not exist, and no package is found.
    with contextlib.suppress(ImportError):
        import ament_index_python.packages  # type: ignore[import-not-found]  # noqa: F401
    file = request["file"]
    reading = guard.Reading(file, request["packages"])
    arguments = guard.Arguments(request["arguments"])
    guard.guard(xacro, substitution_args, reading)
    xacro.verbosity = 0
    sys.setrecursionlimit(DEEPEST)
    _limit(request)
    guard.watch(reading)
    found = str(xacro.process_file(file, verbosity=0, mappings=arguments).toxml())
    arguments.refuse_unknown()
    if len(found) > request["most"]:
        raise Refused(f"it expands to more than {request['most'] / MEGABYTE:.0f} MB")
    return found


def _limit(request: Mapping[str, Any]) -> None:
    """Limit memory, time, files and processes of this process if the system supports it."""
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
        # Some systems do not have a limit or refuse its value.
        with contextlib.suppress(AttributeError, ValueError, OSError):
            resource.setrlimit(getattr(resource, name), (most, most))


def _message(error: BaseException) -> str:
    """The message of an error, or of a recursion or memory error that it wraps."""
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
