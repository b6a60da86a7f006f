"""DXF files opened with ezdxf, quietly, and mended where they are damaged."""

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
    """The document in a DXF file, and sentences on what had to be mended.

    Raises:
        InvalidInput: ezdxf is not installed, or this is no DXF file.
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
    # Whatever a broken file makes ezdxf raise, it is the file that is broken.
    try:
        return _read(data), []
    except Exception as error:
        first = error
    try:
        return _mend(data, first)
    except Exception:
        raise InvalidInput(f"{source} is no DXF file that can be read: {said(first)}.") from None


def _read(data: bytes) -> Any:
    from ezdxf.document import Drawing
    from ezdxf.filemanagement import dxf_stream_info
    from ezdxf.lldxf.tagger import binary_tags_loader

    if data.startswith(BINARY):
        return Drawing.load(binary_tags_loader(data, errors="surrogateescape"))
    # The header, which names the encoding, is plain ASCII.
    info = dxf_stream_info(io.StringIO(data.decode("utf-8", errors="ignore"), newline=None))
    text = data.decode(info.encoding, errors="surrogateescape")
    return Drawing.read(io.StringIO(text, newline=None))


def _mend(data: bytes, first: Exception) -> tuple[Any, list[str]]:
    from ezdxf import recover

    document, auditor = recover.read(io.BytesIO(data))
    changes = len(auditor.errors) + len(auditor.fixes)
    return document, [
        f"The file is damaged ({said(first)}) and was mended in {changes} places; what was broken "
        "may be missing."
    ]


def said(error: Exception) -> str:
    """The first line of what a library said."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    text = lines[0].strip().rstrip(".")
    return text if len(text) <= 120 else text[:117] + "..."


@contextmanager
def quietly() -> Iterator[None]:
    """Without what ezdxf logs: what matters is in the notes of the program."""
    logger = logging.getLogger("ezdxf")
    before = logger.disabled
    logger.disabled = True
    try:
        yield
    finally:
        logger.disabled = before
