"""Files that a page sends: jobs, drawings and robot descriptions.

A job that refers to a drawing needs a file. So what a page sends is kept in a folder of its own
until the end, unless the folder of the job has the same file.
"""

from __future__ import annotations

import secrets
import shutil
import tempfile
from pathlib import Path as FilePath

from armcontour._text import make_printable
from armcontour.errors import InvalidInput
from armcontour.io.cell import OWN_PATH, YAML, cell_names, drawing_text
from armcontour.io.drawings.endings import READERS
from armcontour.io.job_edits import Change
from armcontour.studio.document import Document

# Endings of robot descriptions; .xacro is none of them, as it is a program.
ROBOTS = (".urdf",)
LONGEST = 100


class Uploads:
    """The folder of what pages send; it is made when it is needed.

    Attributes:
        folder: The folder, which may not be there.
    """

    def __init__(self) -> None:
        # Nobody can guess the name, and make the folder before.
        self.folder = FilePath(tempfile.gettempdir()) / f"armcontour-{secrets.token_hex(8)}"

    def open(
        self, name: str, content: bytes, cell: str | None, document: Document
    ) -> Document | list[Change]:
        """Open a file.

        Args:
            name: Its name.
            content: Its bytes.
            cell: For a drawing, the built-in cell to open it in; None changes the document.
            document: The document.

        Returns:
            Another document, or changes of this one.

        Raises:
            InvalidInput: A file of another kind, or one that is no text.
        """
        refuse_name(name)
        ending, folder = FilePath(name).suffix.lower(), document.folder or FilePath.cwd()
        if ending in YAML:
            return Document.of_text(_text(name, content), folder, name)
        if ending in ROBOTS:
            file = self._keep(name, content, folder)
            return [Change(("arm",), {"file": file})]
        if ending not in READERS:
            raise InvalidInput(
                f"{name} is neither a job (.yaml), nor a drawing ({', '.join(READERS)}), nor a "
                "robot (.urdf)."
            )
        file = self._keep(name, content, folder)
        if cell is not None:
            if cell not in cell_names():
                raise InvalidInput(f"There is no cell {cell!r}: take {', '.join(cell_names())}.")
            there = (folder / file).resolve()
            return Document.of_text(drawing_text(cell, there, folder), folder, f"{there.stem}.yaml")
        path = document.data.get("path") or {}
        return [
            *(Change(("path", x)) for x in OWN_PATH if x in path),
            Change(("path", "file"), file),
        ]

    def close(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _keep(self, name: str, content: bytes, beside: FilePath) -> str:
        """Where a file is: beside the job if it is there, else in the folder."""
        there = beside / name
        if there.is_file() and not there.is_symlink() and there.read_bytes() == content:
            return name
        self.folder.mkdir(mode=0o700, exist_ok=True)
        place = self.folder / name
        place.write_bytes(content)
        return str(place)


def refuse_name(name: str) -> None:
    """Refuse what is no plain name of a file.

    Raises:
        InvalidInput: It is none.
    """
    plain = name == FilePath(name).name and "\\" not in name and not name.startswith(".")
    if not plain or len(name) > LONGEST or make_printable(name) != name:
        raise InvalidInput("The name of the file is no plain name.")


def _text(name: str, content: bytes) -> str:
    """The content of a text file."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidInput(f"{name} is no UTF-8 text.") from None
