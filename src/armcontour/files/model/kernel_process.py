"""Starts the kernel process, which reads a CAD file and may end at a damaged one."""

from __future__ import annotations

import importlib.util
import re
from collections import deque
from dataclasses import dataclass
from threading import Lock
from typing import cast

from armcontour.core.errors import FileError, InvalidInput
from armcontour.core.file_access import MEGABYTE
from armcontour.files.model.tables import Request, Tables
from armcontour.files.reader_process import GIGABYTE, ReaderFailed, ReaderLimits, read_in_process

# Longest time for one file [s].
TIME_LIMIT = 600.0
# Processor time for a small file [s], more per megabyte [s], and the largest one [s].
PROCESSOR_TIME = 15
TIME_PER_MEGABYTE = 8
LARGEST_PROCESSOR_TIME = 300
# Memory for a small file, including the libraries of the kernel [bytes], more per byte of the file,
# and the largest one [bytes].
MEMORY_LIMIT = 2 * GIGABYTE
MEMORY_PER_BYTE = 128
LARGEST_MEMORY = 8 * GIGABYTE
# First and last words of a file.
BEGIN = b"ISO-10303-21"
END = b"END-ISO-10303-21"
# Number of bytes at both ends of a file in which these words are searched.
ENDS = 2000
# Entity that names another file, and its short name.
EXTERNAL = re.compile(rb"DOCUMENT_FILE|DCMFL", re.IGNORECASE)
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
    raise FileError(f"{source} {answer}. Export it again as STEP, with solids.")


def check_kernel() -> None:
    """Raise InvalidInput with the installation command if the kernel is not installed."""
    if importlib.util.find_spec("OCP") is None:
        raise InvalidInput(
            "Reading STEP files requires the CAD kernel OCP, which is not installed. Install it "
            "with: pip install 'armcontour[cad]'."
        )


def _check_text(content: bytes, source: str) -> None:
    """Check that a file begins and ends as a STEP file does, and names no other files."""
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
    # The kernel would read parts from these files.
    if EXTERNAL.search(content):
        raise FileError(
            f"{source} refers to other files (DOCUMENT_FILE), which are not read. Export the "
            "assembly as one file, without documents."
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
    size = len(content)
    time = PROCESSOR_TIME + TIME_PER_MEGABYTE * size // MEGABYTE
    limits = ReaderLimits(
        library="the CAD kernel",
        processor_time=min(time, LARGEST_PROCESSOR_TIME),
        duration=TIME_LIMIT,
        memory=min(MEMORY_LIMIT + MEMORY_PER_BYTE * size, LARGEST_MEMORY),
    )
    module = "armcontour.files.model.step_kernel"
    try:
        return cast("Tables | str", read_in_process(module, (content, request), limits))
    except ReaderFailed as error:
        return str(error)
