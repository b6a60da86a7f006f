"""The command `studio`: serves a local web page that shows and edits a job."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import print_line

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
    from armcontour.cli.inputs import is_job
    from armcontour.core.errors import InvalidInput
    from armcontour.core.file_access import LARGE, read_bytes
    from armcontour.files.drawings.endings import find_reader

    if file is None:
        if options.cell is not None:
            raise InvalidInput("--cell requires a drawing. Specify a drawing, or remove --cell.")
        return
    job = is_job(file)
    if job and options.cell is not None:
        raise InvalidInput(
            f"--cell is only allowed with a drawing, but {file.name} is a job, which has its own "
            "arm. Remove --cell."
        )
    if not job:
        find_reader(file)
    if not job and options.cell is None:
        raise InvalidInput(
            f"{file.name} is a drawing, which requires a cell. Specify it with --cell: a built-in "
            "cell such as ur5e, or a job file."
        )
    read_bytes(file, "job file" if job else "drawing", maximum=LARGE)


def _session(
    file: FilePath | None, options: StudioOptions, say: Callable[[bytes], None]
) -> Session:
    """Open the document in a session; this loads the numerical libraries."""
    from armcontour.studio.connection import open_session

    return open_session(file, cell=options.cell, send=say)


def _announce(address: str, open_page: bool) -> None:
    """Print the address of the page, and open the page in a browser."""
    print_line(f"Studio: {address}")
    print_line("Do not share the address, because it contains a key. Ctrl+C ends the Studio.")
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
