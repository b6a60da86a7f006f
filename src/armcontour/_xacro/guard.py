"""Guards around xacro in the child process: bounded evaluation, files and calls."""

from __future__ import annotations

import errno
import io
import os
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import Any

from armcontour import _files
from armcontour._xacro.expressions import (
    OPERATIONS,
    Lacking,
    Refused,
    bounded_factorial,
    bounded_range,
    compile_expression,
)
from armcontour._xacro.packages import find_near, own_package
from armcontour.errors import InvalidInput

# Largest depth of macros that call one another and of files that include one another; robot
# descriptions have about 10.
MOST_DEEP = 100
# Longest text that an expression makes [characters].
LONGEST_TEXT = 1_000_000
PACKAGE = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
# Functions that give access to the attributes of values.
INNER_SYMBOLS = ("type", "vars")
# First words of the audit events that are refused: the interpreter raises them before it accesses
# the system.
TOUCHING = {"_winapi", "code", "ctypes", "fcntl", "ftplib", "function", "gc", "http", "mmap"}
TOUCHING |= {"msvcrt", "object", "os", "pickle", "pty"}
TOUCHING |= {"shutil", "signal", "smtplib", "socket", "sqlite3", "subprocess", "syslog", "tempfile"}
TOUCHING |= {"urllib", "webbrowser", "winreg"}
# Prefixes of modules that the interpreter loads at first use: codecs, and parts of the XML reader.
LOADED_LATER = ("encodings.", "pyexpat", "xml.")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
# Folder of the packages that are not found, which may be named, but not read.
NOWHERE = FilePath(os.sep) / "package-not-found"


class Reading:
    """The files that a description may read: below its own folder and in packages that it names.

    Args:
        file: The description.
        packages: Folders of packages, by name.

    Attributes:
        file: Real path of the description.
        folder: Folder of the description.
        packages: Folders of packages, by name, with those that were found.
        folders: Folders below which files may be read.
        looks_for_package: Whether a package is being looked for, which may read any folder.
    """

    def __init__(self, file: str, packages: Mapping[str, str] | None = None) -> None:
        self.file = FilePath(os.path.realpath(file))
        self.folder = FilePath(os.path.abspath(os.path.dirname(file)))
        self.packages = dict(packages or {})
        own = own_package(self.folder)
        readable = [self.folder] if own is None else [self.folder, own]
        self.folders = [FilePath(os.path.realpath(x)) for x in readable]
        self.looks_for_package = False

    def allows(self, name: str | bytes) -> bool:
        """Whether a file or folder may be read; a link counts as its target."""
        target = FilePath(os.path.realpath(os.fsdecode(name)))
        return target == self.file or any(target.is_relative_to(x) for x in self.folders)

    def refuse(self, name: str | bytes) -> None:
        """Refuse a file that may not be read.

        Raises:
            Lacking: The file belongs to a package that was not found.
            Refused: The file may not be read.
        """
        place = FilePath(os.fsdecode(name))
        if NOWHERE in place.parents:
            package = place.relative_to(NOWHERE).parts[0]
            raise Lacking(
                f"it reads files of the package {package!r}, which no package.xml near it names, "
                f"nor a sourced ROS: give its folder with packages={{{package!r}: ...}} (in a "
                f"job, arm.packages; beside --arm, --package {package}=FOLDER)"
            )
        if not self.allows(name):
            raise Refused(
                f"it reads {os.fsdecode(name)!r}, which lies outside of the folder of the "
                f"description, {str(self.folders[0])!r}"
            )


class Arguments(dict[str, str]):
    """Values of the arguments of a description, by name; remembers which it declares.

    Args:
        given: The values that are given.
    """

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self._unknown = dict.fromkeys(given)
        self._declared: dict[str, None] = {}

    def __contains__(self, name: object) -> bool:
        """Whether an argument has a value; xacro asks this where it is declared."""
        self._declared[str(name)] = None
        self._unknown.pop(str(name), None)
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        """The value of an argument.

        Raises:
            Lacking: It has none.
        """
        if name not in self:
            raise Lacking(
                f"it needs a value of its argument {name!r}: give it with "
                f"arguments={{{name!r}: ...}} (in a job, arm.arguments; beside --arm, "
                f"--xacro-arg {name}=VALUE)"
            )
        return super().__getitem__(name)

    def refuse_unknown(self) -> None:
        """Refuse a given argument that the description neither declared nor used.

        Raises:
            Lacking: There is one.
        """
        for name in self._unknown:
            raise Lacking(
                f"it has no argument {name!r}: it takes {', '.join(self._declared) or 'none'}"
            )


def guard(xacro: Any, substitution: Any, reading: Reading) -> None:
    """Replace the functions by which xacro evaluates expressions and reads files by guarded ones.

    Args:
        xacro: The module xacro.
        substitution: The module xacro.substitution_args.
        reading: The files that may be read.
    """
    xacro.safe_eval = _safe_eval
    substitution._eval = _evaluator(substitution)
    substitution._eval_env = _refuse_env
    substitution._eval_optenv = _refuse_env
    substitution._eval_find = _finder(substitution, reading)
    # A function of the module hides the builtin one.
    xacro.open = _opener(xacro, reading)
    xacro.eval_text = _bounded_text(xacro.eval_text)
    xacro.handle_macro_call = _bounded_calls(xacro, xacro.handle_macro_call)
    symbols = xacro._global_symbols
    for table in (symbols, symbols["math"], symbols["python"]):
        for name in INNER_SYMBOLS:
            dict.pop(table, name, None)
        for name, bounded in BOUNDED.items():
            if dict.__contains__(table, name):
                dict.__setitem__(table, name, bounded)


def watch(reading: Reading) -> None:
    """Install an audit hook that refuses access to the system from now on.

    No code can remove an audit hook, so it also stops an expression that passes the other checks.

    Args:
        reading: The files that may be read.
    """
    library = FilePath(os.path.realpath(os.path.dirname(os.__file__)))

    def hook(event: str, args: tuple[Any, ...]) -> None:
        if event == "open":
            _check_open(args, reading, library)
        elif event in ("os.listdir", "os.scandir", "glob.glob", "glob.glob/2"):
            if event.startswith("os.") and not reading.looks_for_package:
                reading.refuse("." if args[0] is None else args[0])
        elif event == "import":
            if not str(args[0]).startswith(LOADED_LATER):
                raise Refused(f"it loads the module {args[0]!r}")
        elif event.split(".")[0] in TOUCHING:
            raise Refused(f"it calls {event}")

    sys.addaudithook(hook)


def _check_open(args: tuple[Any, ...], reading: Reading, library: FilePath) -> None:
    """Refuse to open a file for writing, or for reading if it may not be read.

    Args:
        args: Arguments of the audit event `open`: name, mode and flags.
        reading: The files that may be read.
        library: Folder of Python's standard library, which may be read.

    Raises:
        Refused: The file must not be opened.
    """
    name, mode, flags = (*args, None, None)[:3]
    if isinstance(name, int):
        return
    writes = any(x in (mode or "") for x in "wax+") or bool((flags or 0) & WRITING)
    if writes:
        raise Refused(f"it writes {os.fsdecode(name)!r}")
    inside = FilePath(os.path.realpath(os.fsdecode(name))).is_relative_to(library)
    if not inside and not reading.looks_for_package:
        reading.refuse(name)


class _Names:
    """The names of an expression: bounded operators, which no symbol can hide, then symbols."""

    def __init__(self, symbols: Any) -> None:
        self._symbols = symbols

    def __getitem__(self, name: str) -> Any:
        return OPERATIONS[name] if name in OPERATIONS else self._symbols[name]


def _safe_eval(expr: str, symbols: Any) -> Any:
    """Evaluate an expression `${...}`; replaces xacro's function of this name."""
    names: Any = _Names(symbols)
    return eval(compile_expression(expr), {"__builtins__": {}}, names)


def _evaluator(substitution: Any) -> Callable[[str, dict[str, Any]], str]:
    """A function that evaluates `$(eval ...)`; xacro's own gives access to all builtins."""
    given = substitution._eval_dict
    symbols = {key: value for key, value in given.items() if not key.startswith("_")}
    symbols |= {x.__name__: x for x in (list, dict, map, str, float, int)}
    symbols |= {name: bounded for name, bounded in BOUNDED.items() if name in given}
    symbols |= {"env": _refuse_env, "optenv": _refuse_env}
    # The guarded function is looked up at the time of the call.
    symbols["find"] = lambda name: substitution._eval_find(name)

    def evaluate(text: str, context: dict[str, Any]) -> str:
        args = context.setdefault("arg", {})

        def arg(name: str) -> Any:
            return substitution.convert_value(substitution._eval_arg(name, args=args), "auto")

        def dirname() -> Any:
            return substitution._eval_dirname(context["filename"])

        # A plain copy: a name that is no argument may be one of Python.
        names = substitution._DictWrapper(dict(args), {"arg": arg, "dirname": dirname} | symbols)
        return str(_safe_eval(text, names))

    return evaluate


def _refuse_env(name: str, default: str = "") -> str:
    """Refuse to read an environment variable."""
    raise Refused(f"it reads the environment variable {name!r}, and the environment is not read")


def _refuse_count(*args: object, **options: object) -> int:
    """Refuse functions with unbounded results."""
    raise Refused("it calls comb, perm, prod or sumprod, whose results have no bound")


# Replacements of functions whose results could be of any size.
BOUNDED: dict[str, Callable[..., Any]] = {
    "factorial": bounded_factorial,
    "range": bounded_range,
    **dict.fromkeys(("comb", "perm", "prod", "sumprod"), _refuse_count),
}


def _finder(substitution: Any, reading: Reading) -> Callable[[str], str]:
    """A function that returns the folder of a package, whose files may then be read.

    A package is searched among those that are named, then in a sourced ROS, then by the
    `package.xml` near the description. One that is not found has a folder that cannot be read:
    many descriptions name packages of which they need no file, for simulators.
    """
    ros = substitution._eval_find

    def found(name: str) -> str:
        if not isinstance(name, str) or not PACKAGE.fullmatch(name):
            raise Refused(f"$(find ...) names {name!r}, which is not the name of a package")
        if name not in reading.packages:
            reading.looks_for_package = True
            try:
                folder = _in_ros(ros, name) or find_near(reading.folder, name)
            finally:
                reading.looks_for_package = False
            reading.packages[name] = str(NOWHERE / name if folder is None else folder)
        place = FilePath(reading.packages[name])
        if NOWHERE not in place.parents:
            reading.folders.append(FilePath(os.path.realpath(place)))
        return str(place)

    return found


def _in_ros(find: Callable[[str], str], name: str) -> str | None:
    """The folder of a package in a sourced ROS; None without ROS or such a package."""
    if "ament_index_python.packages" not in sys.modules:
        return None
    try:
        return str(find(name))
    except LookupError:
        return None


def _opener(xacro: Any, reading: Reading) -> Callable[[str], io.BytesIO]:
    """A function that opens included files and the files of `load_yaml`."""

    def opened(name: str) -> io.BytesIO:
        reading.refuse(name)
        if len(xacro.filestack or ()) > MOST_DEEP:
            raise Refused(f"its files include one another more than {MOST_DEEP} deep")
        if not os.path.exists(name):
            # xacro catches this error for optional includes.
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        try:
            return io.BytesIO(_files.read_bytes(name, "included file"))
        except InvalidInput as error:
            raise Refused(str(error).rstrip(".")) from None

    return opened


def _bounded_text(evaluate: Callable[..., Any]) -> Callable[..., Any]:
    """The function that evaluates the expressions of a text, with a bounded result."""

    def eval_text(text: str, symbols: Any) -> Any:
        found = evaluate(text, symbols)
        if isinstance(found, str) and len(found) > max(LONGEST_TEXT, len(text)):
            raise Refused(f"its expressions make a text of more than {LONGEST_TEXT} characters")
        return found

    return eval_text


def _bounded_calls(xacro: Any, call: Callable[..., Any]) -> Callable[..., Any]:
    """The function that calls a macro, with a bounded depth of calls."""

    def handle_macro_call(node: Any, macros: Any, symbols: Any) -> Any:
        if len(xacro.macrostack) > MOST_DEEP:
            raise Refused(f"its macros call one another more than {MOST_DEEP} deep")
        return call(node, macros, symbols)

    return handle_macro_call
