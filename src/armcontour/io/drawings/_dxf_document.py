"""DXF files opened with ezdxf, and repaired by ezdxf if they are damaged."""

from __future__ import annotations

import contextlib
import io
import itertools
import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from armcontour._describing import several
from armcontour._text import list_some
from armcontour.errors import InvalidInput
from armcontour.io.drawings.reading import SKIP

BINARY = b"AutoCAD Binary DXF"
DRAWING_DATABASE = b"AC10"
CUT_OFF = "The file has no end mark (EOF): it seems to be cut off, and contours may be missing."
# What is between entities.
STRUCTURE = ("SECTION", "ENDSEC", "TABLE", "ENDTAB", "EOF")
# Codes of which one comes first in the class of a SPLINE.
SPLINE_CODES = ("10", "40", "70", "71", "72", "73", "74", "210")
# Numbers of objects in ezdxf's messages.
ADDRESS = re.compile(r"\(#\d+\)")


def open_document(data: bytes, source: str, *, skip: bool) -> tuple[Any, list[str]]:
    """Open the document in a DXF file.

    Args:
        data: Content of the file, ASCII or binary.
        source: Name of the file.
        skip: Whether entities that ezdxf cannot read are left out.

    Returns:
        ezdxf's document, and a sentence on the damage if the file had to be repaired.

    Raises:
        InvalidInput: ezdxf is not installed, or the data are not a DXF file.
    """
    try:
        import ezdxf  # noqa: F401
    except ImportError:
        raise InvalidInput(
            "Reading DXF files needs ezdxf: pip install 'armcontour[drawings]'."
        ) from None
    if data.startswith(DRAWING_DATABASE):
        raise InvalidInput(f"{source} is a DWG file, which is not read: save it as DXF.")
    if not data.strip():
        raise InvalidInput(f"{source} is empty.")
    if not (data.startswith(BINARY) or b"SECTION" in data):
        raise InvalidInput(f"{source} is no DXF file: it has no section.")
    # A broken file makes ezdxf raise exceptions of any class.
    notes = [] if _has_end(data) else [CUT_OFF]
    try:
        return _read(data), notes
    except Exception as error:
        first = error
    try:
        document, changes = _repair(data)
        if notes and not changes:
            # What is left of a file that is cut off is intact.
            return document, notes
        mended = f" and was mended in {several(changes, 'place')}" if changes else ""
        why = ADDRESS.sub("", said(first))
        damage = f"The file is damaged ({why}){mended}; damaged parts may be missing."
        return document, [*notes, damage]
    except Exception:
        rest, broken = (b"", []) if data.startswith(BINARY) else _without_broken(data)
    if not broken:
        with contextlib.suppress(Exception):
            return _read(rest), notes
        raise InvalidInput(
            f"{source} is no DXF file that can be read: {' '.join([_reason(first), *notes])}"
        )
    if not skip:
        raise InvalidInput(f"{source} has an entity that cannot be read, {broken[0]}: {SKIP}.")
    try:
        document = _read(rest)
    except Exception as error:
        raise InvalidInput(f"{source} is no DXF file that can be read: {said(error)}.") from None
    return document, [
        *notes,
        f"Left out, because it cannot be read: {list_some(broken, 6)}.",
    ]


def _has_end(data: bytes) -> bool:
    """Whether the last line of an ASCII file is its end mark."""
    return data.startswith(BINARY) or data.rstrip(b"\0\x1a \t\r\n").endswith(b"EOF")


def _read(data: bytes) -> Any:
    """Ezdxf's document of an intact file."""
    from ezdxf.document import Drawing
    from ezdxf.filemanagement import dxf_stream_info
    from ezdxf.lldxf.tagger import binary_tags_loader

    if data.startswith(BINARY):
        return Drawing.load(binary_tags_loader(data, errors="surrogateescape"))
    # The header names the encoding; the header itself is plain ASCII.
    info = dxf_stream_info(io.StringIO(data.decode("utf-8", errors="ignore"), newline=None))
    text = data.decode(info.encoding, errors="surrogateescape")
    return Drawing.read(io.StringIO(text, newline=None))


def _reason(error: Exception) -> str:
    """Why ezdxf cannot read a file, as a sentence; its own mistakes tell a user nothing."""
    from ezdxf.lldxf.const import DXFError

    if isinstance(error, DXFError):
        return f"{ADDRESS.sub('', said(error))}."
    return "its structure is damaged. Open it in a CAD program, and save it again."


def _repair(data: bytes) -> tuple[Any, int]:
    """Ezdxf's document of a damaged file, and in how many places it was mended."""
    from ezdxf import recover

    document, auditor = recover.read(io.BytesIO(data))
    return document, len(auditor.errors) + len(auditor.fixes)


def _without_broken(data: bytes) -> tuple[bytes, list[str]]:
    """An ASCII file without the entities that ezdxf cannot make, and sentences on these."""
    from ezdxf.entities import factory
    from ezdxf.lldxf.extendedtags import ExtendedTags

    text = data.decode("utf-8", errors="surrogateescape")
    lines = text.replace("\r\n", "\n").split("\n")
    first = next(
        (i for i, x in enumerate(lines) if x.strip() in ("BLOCKS", "ENTITIES")), len(lines)
    )
    # Codes and values alternate; the code 0 begins an entity.
    begins = [i for i in range(first + 1, len(lines) - 1, 2) if lines[i].strip() == "0"]
    kept, broken = lines[: begins[0] if begins else len(lines)], []
    for i, end in itertools.pairwise([*begins, len(lines)]):
        kind, part = lines[i + 1].strip(), lines[i:end]
        if kind == "SPLINE" and "AcDbSpline" not in part:
            part = _mark_spline(part)
        try:
            if kind not in STRUCTURE:
                factory.load(ExtendedTags.from_text("\n".join(part) + "\n"), None)
        except Exception as error:
            broken.append(f"{kind} in line {i + 2} ({ADDRESS.sub('', said(error))})")
        else:
            kept += part
    return "\n".join([*kept, ""]).encode("utf-8", errors="surrogateescape"), broken


def _mark_spline(lines: list[str]) -> list[str]:
    """A SPLINE with the marks of its classes, which some programs leave out."""
    own = next((k for k in range(0, len(lines), 2) if lines[k].strip() in SPLINE_CODES), len(lines))
    marks = ["100", "AcDbEntity", "100", "AcDbSpline"]
    return [*lines[:own], *marks, *lines[own:]] if "100" not in map(str.strip, lines) else lines


def line_of_handle(data: bytes, handle: str) -> str:
    """` in line 12`, where the entity of a handle says it; "" if the file does not."""
    found = re.search(
        rb"^[ \t]*5[ \t]*\r?\n[ \t]*0*" + re.escape(handle.encode()) + rb"[ \t]*\r?$",
        data,
        re.MULTILINE | re.IGNORECASE,
    )
    return f" in line {data.count(bytes([10]), 0, found.start()) + 2}" if found else ""


def said(error: Exception) -> str:
    """The first line of an exception's message, shortened to 120 characters."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    text = lines[0].strip().rstrip(".")
    return text if len(text) <= 120 else text[:117] + "..."


@contextmanager
def silence_log() -> Iterator[None]:
    """Switch off ezdxf's log; what the user must know is in the notes of the program."""
    logger = logging.getLogger("ezdxf")
    before = logger.disabled
    logger.disabled = True
    try:
        yield
    finally:
        logger.disabled = before
