"""The command `studio`: serves a local web page that shows and edits a job."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable
from typing import TYPE_CHECKING

from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import Studio
from armcontour.cli.console import print_lines
from armcontour.cli.inputs import find_file, is_job
from armcontour.cli.interruption import before_interrupt
from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import MAX_RECORDED, read_bytes
from armcontour.core.progress import Progress
from armcontour.studio.connection import SessionHost, open_session
from armcontour.studio.server import require_server, serve

if TYPE_CHECKING:
    from armcontour.studio.session import Session


def studio(options: Studio, _: None, progress: Progress) -> Outcome:
    """Serve the page until a signal ends it."""
    require_server()
    _check(options)

    def open_job(send: Callable[..., None]) -> Session:
        return open_session(options.job, cell=options.cell, send=send)

    hosts: list[SessionHost] = []
    with before_interrupt(lambda: _unsaved(hosts)), before_interrupt(lambda: _leave(hosts)):
        serve(
            open_job,
            port=options.port,
            announce=lambda address: _announce(address, options.open_page),
            opened=hosts.append,
        )
    return Outcome()


def _check(options: Studio) -> None:
    """Raise InvalidInput for invalid files and options, before slow imports."""
    file = options.job
    if file is not None:
        kind = "job file" if is_job(file) else "drawing"
        read_bytes(find_file(file, options.cell), kind, maximum=MAX_RECORDED)
    elif options.cell is not None:
        raise InvalidInput("--cell requires a drawing. Specify a drawing, or remove --cell.")


def _announce(address: str, open_page: bool) -> None:
    """Print the address of the page, and open the page in a browser."""
    print_lines(f"Studio: {address}")
    print_lines("Do not share the address, because it contains a key. Ctrl+C ends the Studio.")
    if open_page:
        # The call is in a thread, because some browsers return only when they are closed.
        threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()


def _leave(hosts: list[SessionHost]) -> None:
    """Close the sessions, which ends their task processes."""
    for session in (x.session for x in hosts if x.session is not None):
        session.close()


def _unsaved(hosts: list[SessionHost]) -> str | None:
    """Return the message about unsaved changes of the document; None without any."""
    sessions = (x.session for x in hosts if x.session is not None)
    return next((x.editor.document.unsaved() for x in sessions), None)
