"""The function `expand_xacro`, which runs the guarded child process and reads its answer."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import threading
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import IO, Any

from armcontour import _files
from armcontour._process import import_path
from armcontour._text import make_printable
from armcontour.errors import InvalidInput

# Time limit [s]; the largest public descriptions take about 2 s.
SECONDS = 10.0
# Memory limit of the process [MB]; the largest public descriptions need a tenth of it.
MEGABYTES = 1000
# Largest answer [bytes]: JSON may write a character as six.
MOST_ANSWER = 6 * _files.SMALL
# Environment variables that the interpreter may need to start, and ROS to find packages.
KEPT = ("AMENT_PREFIX_PATH", "DYLD_LIBRARY_PATH", "LD_LIBRARY_PATH", "SYSTEMROOT")

# Value of an argument of a xacro file.
Value = str | int | float | bool


def expand_xacro(
    file: FilePath,
    *,
    packages: Mapping[str, str | FilePath] | None = None,
    arguments: Mapping[str, Value] | None = None,
    seconds: float = SECONDS,
) -> str:
    """Expand a trusted xacro file to the text of a robot description.

    Args:
        file: The xacro file.
        packages: Folders of ROS packages by name; others are looked for.
        arguments: Values of the file's arguments by name.
        seconds: Time limit [s].

    Raises:
        InvalidInput: xacro is not installed, a package or an argument is lacking, the file does
            something that is refused, or it cannot be expanded within the time limit.
    """
    if importlib.util.find_spec("xacro") is None:
        raise InvalidInput(
            f"{file} needs the package xacro, which is not installed: pip install "
            "'armcontour[ros]', or expand it to a .urdf elsewhere."
        )
    wishes = {"packages": _folders(packages or {}), "arguments": _texts(arguments or {})}
    answer = _answer(file, seconds, wishes)
    if "text" in answer:
        text = str(answer["text"])
        # What it includes was read by the other process.
        _files.tell_content(file.with_name(f"{file.name} expanded"), text.encode())
        return text
    if "lacking" in answer:
        raise InvalidInput(f"{file} is not expanded: {_printable(answer['lacking'])}.")
    if "refused" in answer:
        raise InvalidInput(
            f"{file} is not expanded: {_printable(answer['refused'])}; if that is intended, expand "
            "it to a .urdf with the program xacro itself, which refuses nothing."
        )
    message = _printable(answer.get("failed", "its process ended without an answer"))
    raise InvalidInput(f"{file} cannot be expanded by xacro: {message}.")


def _folders(packages: Mapping[str, str | FilePath]) -> dict[str, str]:
    """The absolute folders of packages.

    Raises:
        InvalidInput: There is no such folder.
    """
    for name, folder in packages.items():
        if not os.path.isdir(folder):
            raise InvalidInput(f"The folder of the package {name}, {folder}, is not there.")
    return {str(name): os.path.abspath(folder) for name, folder in packages.items()}


def _texts(arguments: Mapping[str, Value]) -> dict[str, str]:
    """The values of arguments as xacro reads them.

    Raises:
        InvalidInput: A value that is neither text, a number, nor true or false.
    """
    for name, value in arguments.items():
        if not isinstance(value, Value):
            raise InvalidInput(
                f"The argument {name} of a xacro file must be text, a number, or true or false, "
                f"not {type(value).__name__}."
            )
    return {
        str(name): str(value).lower() if isinstance(value, bool) else str(value)
        for name, value in arguments.items()
    }


def _answer(file: FilePath, seconds: float, wishes: Mapping[str, Any]) -> dict[str, Any]:
    """The answer of a child process that expands a file; empty if it gave none."""
    absolute = os.path.abspath(file)
    request = {
        **wishes,
        "file": absolute,
        "path": import_path(os.path.dirname(absolute)),
        "seconds": seconds,
        "megabytes": MEGABYTES,
        "most": _files.SMALL,
    }
    process = _start(file, os.path.dirname(absolute))
    answer: list[bytes] = []
    # Not all systems can read pipes with a time limit, so another thread reads the answer.
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


def _start(file: FilePath, folder: str) -> subprocess.Popen[bytes]:
    """Start the child process, with only those environment variables that it needs.

    Raises:
        InvalidInput: The process cannot be started.
    """
    child = str(FilePath(__file__).with_name("child.py"))
    try:
        return subprocess.Popen(
            # Isolated, without bytecode files, without warnings, with UTF-8.
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
    """Read a pipe into a list of blocks, up to `MOST_ANSWER`."""
    size = 0
    while block := pipe.read(1 << 20):
        size += len(block)
        if size > MOST_ANSWER:
            return
        answer.append(block)


def _write(pipe: IO[bytes] | None, line: bytes) -> None:
    """Write a line to a pipe; errors are ignored, because an ended process gives no answer."""
    try:
        while pipe is not None and line:
            line = line[pipe.write(line) :]
    except OSError:
        pass


def _parse(answer: list[bytes]) -> dict[str, Any]:
    """The JSON object of an answer; empty if the answer is not one."""
    try:
        found = json.loads(b"".join(answer))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _printable(text: object) -> str:
    """A text of the child process, shortened and with escapes for unprintable characters."""
    return make_printable(str(text)[:500].rstrip(". "))
