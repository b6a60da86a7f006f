"""Files from which a result was computed, with their fingerprints."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from datetime import UTC, datetime

# Number of hexadecimal digits of a fingerprint, which distinguish the versions of a file.
DIGITS = 12
# Environment variable with the time of reproducible files [s since 1970, UTC], as other tools read
# it, see https://reproducible-builds.org/specs/source-date-epoch.
EPOCH = "SOURCE_DATE_EPOCH"


@dataclass(frozen=True, slots=True)
class SourceFile:
    """A file from which a result was computed.

    Args:
        name: Name of the file without its folder, or of a part of the package.
        fingerprint: Fingerprint of its content, see `fingerprint`.
    """

    name: str
    fingerprint: str

    @classmethod
    def from_text(cls, name: str, text: str) -> SourceFile:
        """Return the name and the fingerprint of a file with a text, encoded as UTF-8."""
        return cls(name, fingerprint(text.encode()))


def fingerprint(content: bytes) -> str:
    """Return the first 12 digits of the SHA-256 checksum, as `sha256sum` prints it.

    >>> fingerprint(b"name: corner")
    'c648a00f0091'
    """
    return hashlib.sha256(content).hexdigest()[:DIGITS]


def writing_time() -> datetime:
    """Return the present time, or that of the environment variable `EPOCH`."""
    fixed = os.environ.get(EPOCH)
    if fixed is None:
        return datetime.now().astimezone()
    return datetime.fromtimestamp(int(fixed), UTC)
