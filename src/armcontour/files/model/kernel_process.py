"""Starts the kernel process, which reads a CAD file and may end at a damaged one."""

from __future__ import annotations

import importlib.util
import os
import pickle
import subprocess
import sys
import tempfile
from collections import deque
from dataclasses import dataclass
from pathlib import Path as FilePath
from threading import Lock
from typing import cast

from armcontour.core.errors import FileError, InvalidInput
from armcontour.core.pool import ENVIRONMENT, can_start
from armcontour.files.model.tables import Request, Tables

# Longest time for one file [s].
TIME_LIMIT = 300.0
# Largest memory of the process, including the libraries that it loads [bytes].
MEMORY_LIMIT = 8 * 1024**3
# First and last words of a file.
BEGIN = b"ISO-10303-21"
END = b"END-ISO-10303-21"
# Number of bytes at both ends of a file in which these words are searched.
ENDS = 2000
# Entity of a file that names other files.
EXTERNAL = b"DOCUMENT_FILE"
# Number of answers that are kept, because the path, the scene and the Studio ask for the same.
KEPT = 8


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What the kernel process has answered: tables, or the end of a sentence on the file."""

    content: bytes
    request: Request
    answer: Tables | str


_answers: deque[Answer] = deque(maxlen=KEPT)
# Threads that ask for the same file wait for one answer.
_asking = Lock()


def ask_kernel(content: bytes, source: str, request: Request) -> Tables:
    """Read a STEP file in a process of its own.

    Args:
        content: Content of the file.
        source: Name of the file, for messages.
        request: What is computed besides the tables of parts, faces and edges.

    Raises:
        InvalidInput: The kernel is not installed.
        FileError: The file cannot be read, has no surfaces, or takes too long.
    """
    check_kernel()
    _check_text(content, source)
    answer = _known_or_asked(content, request)
    if isinstance(answer, Tables):
        return answer
    if EXTERNAL in content:
        raise FileError(
            f"{source} refers to parts in other files, which are not read. Export the assembly as "
            "one file."
        )
    raise FileError(f"{source} {answer}. Export it again as STEP, with solids.")


def check_kernel() -> None:
    """Raise InvalidInput with the installation command if the kernel is not installed."""
    if importlib.util.find_spec("OCP") is None:
        raise InvalidInput(
            "Reading STEP files requires the CAD kernel OCP, which is not installed. Install it "
            "with: pip install 'armcontour[cad]'."
        )
    if not can_start():
        raise InvalidInput(
            "STEP files are read by a process of Python, which cannot be started here. Run "
            "armcontour with Python."
        )


def _check_text(content: bytes, source: str) -> None:
    """Check that a file begins and ends as a STEP file does."""
    if not content.strip():
        raise FileError(f"{source} is empty. Export it again as STEP.")
    if BEGIN not in content[:ENDS]:
        raise FileError(
            f"{source} is not a STEP file, because it does not begin with ISO-10303-21."
        )
    if END not in content[-ENDS:]:
        raise FileError(
            f"{source} is incomplete, because it does not end with END-ISO-10303-21. Export or "
            "copy it again."
        )


def _known_or_asked(content: bytes, request: Request) -> Tables | str:
    """Return a known answer that covers a request, or ask the kernel process."""
    with _asking:
        for known in _answers:
            if known.request.covers(request) and known.content == content:
                return known.answer
        answer = _ask(content, request)
        _answers.appendleft(Answer(content, request, answer))
        return answer


def _ask(content: bytes, request: Request) -> Tables | str:
    """Return the answer of the kernel process."""
    with tempfile.TemporaryDirectory(prefix="armcontour-") as name:
        folder = FilePath(name)
        (folder / "model.step").write_bytes(content)
        (folder / "request").write_bytes(pickle.dumps(request))
        files = [str(folder / x) for x in ("model.step", "request", "answer")]
        module = "armcontour.files.model.step_kernel"
        command = [sys.executable, "-m", module, *files, str(MEMORY_LIMIT)]
        try:
            done = subprocess.run(
                command,
                env={**os.environ, **ENVIRONMENT},
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=TIME_LIMIT,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return f"takes more than {TIME_LIMIT:.0f} s to read"
        answer = folder / "answer"
        if done.returncode != 0 or not answer.exists():
            return "cannot be read, because the CAD kernel failed"
        return cast("Tables | str", pickle.loads(answer.read_bytes()))
