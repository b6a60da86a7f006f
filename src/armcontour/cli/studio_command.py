"""The command `studio`: serves a local web page that shows and edits a job."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import print_lines

if TYPE_CHECKING:
    from armcontour.cli.options import StudioOptions
    from armcontour.studio.connection import SessionHost
    from armcontour.studio.session import Session


def open_studio(file: FilePath | None, options: StudioOptions) -> None:
    """Serve the Studio until a signal."""
    from armcontour.cli.interrupts import before_interrupt
    from armcontour.studio.server import require_server, serve

    require_server()
    _check(file, options)

    session_hosts: list[SessionHost] = []
    with (
        before_interrupt(lambda: _unsaved(session_hosts)),
        before_interrupt(lambda: _leave(session_hosts)),
    ):
        serve(
            lambda say: _session(file, options, say),
            port=options.port,
            announce=lambda address: _announce(address, options.open_page),
            opened=session_hosts.append,
        )


def _check(file: FilePath | None, options: StudioOptions) -> None:
    """Raise InvalidInput for invalid files and options, before slow imports."""
    from armcontour.cli.inputs import find_file, is_job
    from armcontour.core.errors import InvalidInput
    from armcontour.core.file_access import LARGE, read_bytes

    if file is not None:
        kind = "job file" if is_job(file) else "drawing"
        read_bytes(find_file(file, options.cell), kind, maximum=LARGE)
    elif options.cell is not None:
        raise InvalidInput("--cell requires a drawing. Specify a drawing, or remove --cell.")


def _session(
    file: FilePath | None, options: StudioOptions, say: Callable[[bytes], None]
) -> Session:
    """Open the document in a session; this loads the numerical libraries."""
    from armcontour.studio.connection import open_session

    return open_session(file, cell=options.cell, send=say)


def _announce(address: str, open_page: bool) -> None:
    """Print the address of the page, and open the page in a browser."""
    print_lines(f"Studio: {address}")
    print_lines("Do not share the address, because it contains a key. Ctrl+C ends the Studio.")
    if open_page:
        import threading
        import webbrowser

        # The call is in a thread, because some browsers return only when they are closed.
        threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()


def _leave(session_hosts: list[SessionHost]) -> None:
    """Close the sessions, which ends their task processes."""
    for session_host in session_hosts:
        if session_host.session is not None:
            session_host.session.close()


def _unsaved(session_hosts: list[SessionHost]) -> str | None:
    """Message about unsaved changes of the document; None without any."""
    session = session_hosts[0].session if session_hosts else None
    return None if session is None else session.document.unsaved()
