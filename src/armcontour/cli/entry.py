"""Entry point of the program `armcontour`: signals, errors, exit codes, broken pipes."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from contextlib import suppress

from armcontour.cli.interruption import run_interruptibly
from armcontour.core.errors import ArmContourError
from armcontour.core.text import to_line

# Exit code if the reader of the output has ended, as in `armcontour arms | head -1`.
BROKEN_PIPE = 128 + 13
OUT_OF_MEMORY = (
    "The available memory is not sufficient. Close other programs, or reduce the job by a longer "
    "cycle, fewer runs or --no-simulation."
)


def main() -> None:
    """Run the command line; an error is printed as one sentence and determines the exit code.

    Modules are imported neither from the current folder nor from the folders of the arguments.
    """
    sys.path[:] = import_path(*map(os.path.dirname, sys.argv[1:]))
    # Security: a file .numba_config.yaml in the current folder could name a folder of compiled
    # functions that numba runs. The environment variable overrides the file.
    os.environ.setdefault("NUMBA_CACHE_DIR", "")
    # Skip garbage collection at exit, which saves about 0.5 s. Other collections are less frequent,
    # because a program with thousands of contours has millions of objects without cycles; with the
    # default thresholds, collection takes as long as reading the drawing.
    atexit.register(gc.freeze)
    gc.set_threshold(20_000, 20, 50)
    # Without this value, MuJoCo starts a process that looks for a graphics library, although no
    # command needs it.
    os.environ.setdefault("MUJOCO_GL", "disable")
    # Without this value, pydantic searches all installed packages for plugins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")
    sys.exit(run_interruptibly(_command))


def import_path(*refused: str) -> list[str]:
    """Return the import path without relative folders, the current folder and `refused` folders.

    The parent folder of the package is always included.
    """
    # Files in these folders could replace modules of Python and its libraries.
    package_parent = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))

    def is_kept(folder: str) -> bool:
        is_refused = any(_is_same(folder, x) for x in (os.curdir, *refused))
        return folder == package_parent or (os.path.isabs(folder) and not is_refused)

    return [*([] if package_parent in sys.path else [package_parent]), *filter(is_kept, sys.path)]


def _is_same(one: str, other: str) -> bool:
    """Return whether two paths are the same existing folder."""
    with suppress(OSError):
        return os.path.samefile(one, other)
    return False


def _command() -> int:
    """Run the command and return its exit code; errors are printed as one sentence.

    Commands return the exit codes 0, 1, 7 and 9 themselves (`Outcome.code`); the class of an error
    determines the others (`ArmContourError.exit_code`).
    """
    try:
        code = _run()
        sys.stdout.flush()
        return code
    except ArmContourError as error:
        _complain(str(error))
        return error.exit_code
    except MemoryError:
        _complain(OUT_OF_MEMORY)
        return 1
    except BrokenPipeError:
        _mute()
        return BROKEN_PIPE
    except OSError as error:
        _mute()
        file = f" {error.filename}" if error.filename is not None else ""
        _complain(f"Writing or reading{file} has failed: {error.strerror or error}.")
        return 1


def _run() -> int:
    """Run the typer app and return its exit code."""
    # The modules are imported here, because loading typer takes 0.1 s and signals must already be
    # handled during this time.
    from armcontour.cli.commands import program_for

    try:
        program_for(sys.argv[1:])()
    except SystemExit as end:
        # Click converts a broken pipe to the exit code 1.
        if isinstance(end.__context__, BrokenPipeError):
            raise end.__context__ from None
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def _complain(text: str) -> None:
    """Print a message to the standard error; errors of writing are ignored."""
    with suppress(OSError, ValueError, AttributeError):
        print(f"Error: {to_line(text)}", file=sys.stderr, flush=True)


def _mute() -> None:
    """Redirect the standard output to the null device, so that Python writes no more at exit."""
    with suppress(OSError, ValueError, AttributeError), open(os.devnull, "wb") as null:
        os.dup2(null.fileno(), sys.stdout.fileno())
