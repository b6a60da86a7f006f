"""DXF files opened with ezdxf, and repaired by ezdxf if they are damaged."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from armcontour.errors import InvalidInput

BINARY = b"AutoCAD Binary DXF"
DRAWING_DATABASE = b"AC10"


def open_document(data: bytes, source: str) -> tuple[Any, list[str]]:
    """Open the document in a DXF file.

    Args:
        data: Content of the file, ASCII or binary.
        source: Name of the file.

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
    try:
        return _read(data), []
    except Exception as error:
        first = error
    try:
        return _repair(data, first)
    except Exception:
        raise InvalidInput(f"{source} is no DXF file that can be read: {said(first)}.") from None


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


def _repair(data: bytes, first: Exception) -> tuple[Any, list[str]]:
    """Ezdxf's document of a damaged file, and a sentence on the damage.

    `first` is the exception that the damage caused.
    """
    from ezdxf import recover

    document, auditor = recover.read(io.BytesIO(data))
    changes = len(auditor.errors) + len(auditor.fixes)
    return document, [
        f"The file is damaged ({said(first)}) and was mended in {changes} places; damaged parts "
        "may be missing."
    ]


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
