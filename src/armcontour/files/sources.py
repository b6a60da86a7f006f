"""Files from which a job or logs are read, with their fingerprints."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path as FilePath

from armcontour.core.file_access import listen_to_reading
from armcontour.core.source_file import SourceFile, fingerprint
from armcontour.core.text import key_text, list_some
from armcontour.files.file_keys import Patch
from armcontour.jobs import Job

# Folder of the package, whose own files are no sources of a job.
PACKAGE = FilePath(__file__).parents[1]
# First word of the name of the source that has the values of a patch.
CHANGED = "changed"
# Maximum number of changed keys that are named.
MAX_KEYS = 3


@contextmanager
def recording_sources(
    text: SourceFile, patch: Patch | None = None
) -> Iterator[Callable[[Job], Job]]:
    """Record the files that are read in this context.

    Args:
        text: The text of the job or cell, which is read before.
        patch: Values by keys that replace those of the text; they count as a source.

    Yields:
        A function that returns a job with its sources.
    """
    first = [text]
    if patch:
        names = list_some([key_text(x) for x in patch], MAX_KEYS)
        first.append(SourceFile.from_text(f"{CHANGED} {names}", repr(dict(patch))))
    with recording_files() as read:
        yield lambda job: replace(job, sources=(*first, *read))


@contextmanager
def recording_files() -> Iterator[list[SourceFile]]:
    """Record the files that are read in this context, except those of the package."""
    sources = list[SourceFile]()

    def record(file: FilePath, content: bytes) -> None:
        read = SourceFile(file.name, fingerprint(content))
        if PACKAGE not in file.absolute().parents and read not in sources:
            sources.append(read)

    with listen_to_reading(record):
        yield sources
