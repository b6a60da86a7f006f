"""Expansion of xacro files in a child process, and search for folders of ROS packages.

A xacro file is a program that can run any code with the rights of the user. Therefore only trusted
files are expanded. The limits of time and memory stop a file that does not terminate, but they are
not a protection against malicious files.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path as FilePath
from typing import Any

from armcontour.core import file_access
from armcontour.core.errors import InvalidInput
from armcontour.core.text import make_printable
from armcontour.files.robots.arm_options import Value

# File that marks the folder of a ROS package.
PACKAGE_FILE = "package.xml"
# Maximum number of parent folders in which the package of a description is searched.
MAX_UP = 4
# Maximum number of folders in the search for one package.
MAX_FOLDERS = 2000
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
NAME = re.compile(rb"<name>\s*([^<>]*?)\s*</name>")


def find_near(folder: FilePath, name: str) -> FilePath | None:
    """Nearest folder whose `package.xml` has the package name `name`; None if not found."""
    # The search order is: the package of the description, its subfolders, its sibling folders, the
    # siblings of its parent folder, and their subfolders, as in a workspace of ROS.
    for count, candidate in enumerate(_package_candidates(folder)):
        if count >= MAX_FOLDERS:
            break
        if _package_name(candidate / PACKAGE_FILE) == name:
            return candidate
    return None


def _package_candidates(folder: FilePath) -> Iterator[FilePath]:
    """Yield the folders that can be a package near a folder, the nearest first."""
    near = (folder, *folder.parents[:MAX_UP])
    package = next((x for x in near if (x / PACKAGE_FILE).is_file()), folder)
    yield package
    yield from _subfolders(package)
    yield from _subfolders(package.parent)
    for sibling in _subfolders(package.parent.parent):
        yield sibling
        yield from _subfolders(sibling)


def _subfolders(folder: FilePath) -> list[FilePath]:
    """Subfolders of a folder in alphabetical order; empty if it cannot be read."""
    try:
        with os.scandir(folder) as entries:
            names = [x.name for x in entries if not x.name.startswith(".") and x.is_dir()]
    except OSError:
        return []
    return [folder / x for x in sorted(names)]


def _package_name(file: FilePath) -> str | None:
    """Package name in a `package.xml`; None if it cannot be read or has no name."""
    try:
        if not file.is_file():
            return None
        match = NAME.search(COMMENT.sub(b"", file_access.read_bytes(file, "package file")))
    except (InvalidInput, OSError):
        return None
    return None if match is None else match[1].decode("utf-8", "replace")


# Time limit of an expansion [s]; the largest public descriptions take about 2 s.
MAX_SECONDS = 10.0
# Memory limit of the process [MB]; the largest public descriptions need about 100 MB.
MAX_MEGABYTES = 1000
# Placeholder for the folder of a missing package. A description may name a missing package, such as
# a simulator, but an error is raised if it reads files of the package.
MISSING_FOLDER = os.path.join(os.sep, "package-not-found", "")


def expand_xacro(
    file: FilePath,
    *,
    packages: Mapping[str, str | FilePath] | None = None,
    arguments: Mapping[str, Value] | None = None,
) -> str:
    """Expand a trusted xacro file to the text of a robot description."""
    if importlib.util.find_spec("xacro") is None:
        raise InvalidInput(
            f"Expanding {file} requires the package xacro, which is not installed. Install it with "
            "pip install 'armcontour[ros]', or expand the file to a .urdf with other tools."
        )
    from armcontour.core.child_process import import_path

    path = os.path.abspath(file)
    wishes = {
        "packages": _package_folders(packages or {}),
        "arguments": _argument_texts(arguments or {}),
    }
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-X", "utf8", "-c", f"from {__name__} import main; main()"],
            input=json.dumps({"file": path, **wishes}).encode(),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=os.path.dirname(path),
            # The folder of the file is not in the import path, so that modules next to the file,
            # such as xacro.py, do not replace libraries.
            env=os.environ | {"PYTHONPATH": os.pathsep.join(import_path(os.path.dirname(path)))},
            timeout=MAX_SECONDS,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        answer = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        answer = {"error": f"the expansion takes longer than {MAX_SECONDS:g} s"}
    except OSError as error:
        answer = {"error": f"its Python process cannot be started ({error.strerror})"}
    except ValueError:
        answer = {"error": "its Python process ended without a result"}
    if "error" in answer:
        message = make_printable(answer["error"][:500].rstrip(". "))
        raise InvalidInput(f"{file} cannot be expanded by xacro: {message}.")
    # Listeners cannot observe the files that the child process reads, so they get the expanded
    # text.
    file_access.report_content(file.with_name(f"{file.name} expanded"), answer["text"].encode())
    return str(answer["text"])


def _package_folders(packages: Mapping[str, str | FilePath]) -> dict[str, str]:
    """Absolute paths of the folders of packages, by name; checks that they exist."""
    for name, folder in packages.items():
        if not os.path.isdir(folder):
            raise InvalidInput(f"The folder of the package {name}, {folder}, does not exist.")
    return {str(name): os.path.abspath(folder) for name, folder in packages.items()}


def _argument_texts(arguments: Mapping[str, Value]) -> dict[str, str]:
    """Values of arguments as texts that xacro can read, by name."""
    for name, value in arguments.items():
        if not isinstance(value, Value):
            raise InvalidInput(
                f"The argument {name} of a xacro file must be a text, a number or a boolean, but "
                f"is of type {type(value).__name__}."
            )
    return {
        str(name): str(value).lower() if isinstance(value, bool) else str(value)
        for name, value in arguments.items()
    }


class _MissingValue(BaseException):
    """Error for a missing package or argument; a BaseException, which xacro does not catch."""


class _Arguments(dict[str, str]):
    """Values of arguments by name; `known` has the names that the file declares or reads."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.known: dict[str, None] = {}

    def __contains__(self, name: object) -> bool:
        self.known[str(name)] = None
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        if name not in self:
            raise _MissingValue(
                f"it requires a value of its argument {name!r}. Specify "
                f"arguments={{{name!r}: ...}} (in a job, arm.arguments; with --arm, "
                f"--xacro-arg {name}=VALUE)"
            )
        return super().__getitem__(name)


def main() -> None:
    """Entry point of the child process: write the expanded text or the error as JSON to stdout."""
    request = json.load(sys.stdin)
    try:
        answer = {"text": _expand(**request)}
    # Expressions in the file can raise any exception.
    except (Exception, _MissingValue) as error:
        answer = {"error": _message(error)}
    json.dump(answer, sys.stdout)


def _expand(file: str, packages: dict[str, str], arguments: dict[str, str]) -> str:
    """Expanded text of a xacro file; runs in the child process."""
    import xacro
    from xacro import substitution_args as substitution

    in_ros, absolute = substitution._eval_find, xacro.abs_filename_spec

    def find(name: str) -> str:
        if name not in packages:
            folder = None
            with suppress(ImportError, LookupError):
                folder = in_ros(name)
            packages[name] = str(
                folder or find_near(FilePath(file).parent, name) or MISSING_FOLDER + name
            )
        return packages[name]

    def checked(name: str) -> str:
        if name.startswith(MISSING_FOLDER):
            package = name[len(MISSING_FOLDER) :].split("/")[0]
            raise _MissingValue(
                f"it reads files of the package {package!r}, which was not found in a sourced ROS "
                f"or near the file. Specify its folder with packages={{{package!r}: ...}} (in a "
                f"job, arm.packages; with --arm, --package {package}=FOLDER)"
            )
        return str(absolute(name))

    substitution._eval_find = substitution._eval_dict["find"] = find
    xacro.abs_filename_spec = checked
    _limit_resources()
    mappings = _Arguments(arguments)
    text = str(xacro.process_file(file, verbosity=0, mappings=mappings).toxml())
    for name in arguments.keys() - mappings.known.keys():
        raise _MissingValue(
            f"it has no argument {name!r}. Its arguments are {', '.join(mappings.known)}"
        )
    return text


def _limit_resources() -> None:
    """Limit memory and processor time of this process if the operating system supports it."""
    with suppress(ImportError):
        import resource

        for kind, maximum in (
            (resource.RLIMIT_AS, MAX_MEGABYTES * 1_000_000),
            (resource.RLIMIT_CPU, int(MAX_SECONDS) + 2),
        ):
            with suppress(ValueError, OSError):
                resource.setrlimit(kind, (maximum, maximum))


def _message(error: BaseException) -> str:
    """Message of an error on one line; reports a memory error that xacro has wrapped in it."""
    cause: Any = error
    while cause is not None:
        if isinstance(cause, MemoryError):
            return f"it needs more memory than {MAX_MEGABYTES} MB"
        cause = getattr(cause, "exc", None)
    return " ".join(str(error).split()) or type(error).__name__
