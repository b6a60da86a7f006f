"""Expanding a xacro file in a guarded process: started, watched and ended here."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import threading
from pathlib import Path as FilePath
from typing import IO, Any

from armcontour import _files
from armcontour._text import make_printable
from armcontour.errors import InvalidInput

# The largest public descriptions take some 2 s.
SECONDS = 10.0
# Of the process; the largest public descriptions need a tenth.
MEGABYTES = 1000
# Of the answer: JSON may write a character as six.
MOST_ANSWER = 6 * _files.SMALL
# What an interpreter may need to start, and ROS to find packages.
KEPT = ("AMENT_PREFIX_PATH", "DYLD_LIBRARY_PATH", "LD_LIBRARY_PATH", "SYSTEMROOT")


def expand_xacro(file: FilePath, *, seconds: float = SECONDS) -> str:
    """The robot description that a trusted xacro file expands to.

    Args:
        file: The xacro file.
        seconds: How long it may take [s].

    Raises:
        InvalidInput: xacro is not installed, the file does what is refused, or it cannot be
            expanded in that time.
    """
    if importlib.util.find_spec("xacro") is None:
        raise InvalidInput(
            f"{file} needs the package xacro, which is not installed: install armcontour[ros], or "
            "expand it to a .urdf elsewhere."
        )
    found = _answer(file, seconds)
    if "text" in found:
        return str(found["text"])
    if "refused" in found:
        raise InvalidInput(
            f"{file} is not expanded: {_printable(found['refused'])}; if that is meant, expand it "
            "to a .urdf with the program xacro itself, which refuses nothing."
        )
    said = _printable(found.get("failed", "its process ended without an answer"))
    raise InvalidInput(f"{file} cannot be expanded by xacro: {said}.")


def _answer(file: FilePath, seconds: float) -> dict[str, Any]:
    """The answer of a process that expands a file."""
    place = os.path.abspath(file)
    request = {
        "file": place,
        "path": _import_path(os.path.dirname(place)),
        "seconds": seconds,
        "megabytes": MEGABYTES,
        "most": _files.SMALL,
    }
    process = _start(file, os.path.dirname(place))
    answer: list[bytes] = []
    # Pipes cannot be read with a time limit on all systems, so another thread waits for it.
    reader = threading.Thread(target=_read, args=(process.stdout, answer), daemon=True)
    try:
        reader.start()
        _write(process.stdin, json.dumps(request).encode() + b"\n")
        reader.join(seconds)
        if reader.is_alive():
            return {"refused": f"it takes longer than {seconds:g} s"}
    finally:
        process.kill()
        process.wait()
        reader.join(1.0)
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()
    return _parse(answer)


def _import_path(folder: str) -> list[str]:
    """Where the process imports from: as here, but never from the folder of the description."""
    own, refused = str(FilePath(__file__).parents[2]), os.path.realpath(folder)
    return [own, *(x for x in sys.path if x and os.path.realpath(x) != refused)]


def _start(file: FilePath, folder: str) -> subprocess.Popen[bytes]:
    """The process, with no environment but what it needs."""
    child = str(FilePath(__file__).with_name("child.py"))
    try:
        return subprocess.Popen(
            # Isolated, without warnings, writing no compiled modules.
            [sys.executable, "-I", "-B", "-W", "ignore", "-X", "utf8", child],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            cwd=folder,
            env={key: os.environ[key] for key in KEPT if key in os.environ},
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
    except OSError as error:
        raise InvalidInput(
            f"{file} cannot be expanded by xacro: Python cannot be started for it "
            f"({error.strerror}); expand it to a .urdf elsewhere."
        ) from None


def _read(pipe: IO[bytes], answer: list[bytes]) -> None:
    size = 0
    while block := pipe.read(1 << 20):
        size += len(block)
        if size > MOST_ANSWER:
            return
        answer.append(block)


def _write(pipe: IO[bytes] | None, line: bytes) -> None:
    """Write a line; a process that has ended is told by its lack of an answer."""
    try:
        while pipe is not None and line:
            line = line[pipe.write(line) :]
    except OSError:
        pass


def _parse(answer: list[bytes]) -> dict[str, Any]:
    try:
        found = json.loads(b"".join(answer))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _printable(text: object) -> str:
    """What another process said, in characters that a terminal only shows."""
    return make_printable(str(text)[:500].rstrip(". "))
