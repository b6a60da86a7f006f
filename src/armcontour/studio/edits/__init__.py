"""Named edits of the page as changes of keys of the job file."""

from armcontour.studio.edits.changes import EDITS, changes_of
from armcontour.studio.edits.state import EditState

__all__ = ["EDITS", "EditState", "changes_of"]
