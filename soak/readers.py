"""Broken files: a reader must read them, or refuse them with a sentence that names the file.

It must do so quickly and with little memory.
"""

from __future__ import annotations

import importlib
import resource
import signal
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import armcontour as ac
from armcontour.core.checks import LONGEST_NAME
from armcontour.core.text import LONGEST_SENTENCE
from armcontour.files.drawings.path_reader import READERS
from armcontour.files.drawings.read_options import ReadOptions
from soak import Outcome
from soak.samples import samples

KINDS = {
    "dxf": ".dxf",
    "svg": ".svg",
    "gcode": ".ngc",
    "csv": ".csv",
    "job": ".yaml",
    "stl": ".stl",
    "obj": ".obj",
    "urdf": ".urdf",
    "Srdf": ".srdf",
}
# Files of bodies, which are read from a folder.
BODIES = ("stl", "obj", "urdf", "Srdf")
# Largest time [s] and memory [bytes] for a file of a few kilobytes.
LONGEST = 20.0
LARGEST = 600e6
# How often each kind of change is made.
CHANGES = (0.06, 0.02, 0.1, 0.06, 0.12, 0.12, 0.38, 0.1, 0.02, 0.02)
# Characters of a piece that is repeated until a pattern that goes back would not end.
LONGEST_REPEAT = 60_000
LARGEST_FILE = 200_000
# Texts that often break readers.
TOKENS = (
    b"1e308", b"-1e308", b"nan", b"inf", b"1e-320", b"0", b"-1", b"99999999999999999999", b"\0",
    b"\xff\xfe", b"\n", b"\r\n", b"<", b">", b"&amp;", b"(", b")", b"[", b"%", b";", b",", b"#",
    b"G2", b"G91", b"G20", b"R", b"I", b"Z", b"0\nEOF\n", b"\n  0\nLINE\n", b"\xe2\x88\x92", b"'",
    b'"', b"</g>", b"<g>", b"/>", b"url(#a)", b"M", b"A1 1 0 0 0 0 0",
    b"**9", b"^9**9", b"59:", b"1_0", "\u0663".encode(), "\u202e".encode(), b"\x1b]52;c;cA==\x1b\\",
    b"\xc2\x9b", b"&a ", b"*a", b"<<: *a\n", b"<<: [*a, *a]\n", b": ", b"- ", b"? ", b"!!float ",
    b"9" * 5000, b"display", b"xxxxxxxxxxxxxxxxxxxx" * 5,
)  # fmt: skip


class TooSlow(BaseException):
    """Not an `Exception`, so that no reader takes it for a broken file."""


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Change, lose, double, move or replace a part of the file.

    Mostly a little, and by what could stand in a text, or every file would be refused at once.
    """
    text = bytearray(data)
    for _ in range(int(rng.geometric(0.6))):
        a = int(rng.integers(0, len(text) + 1))
        b = min(len(text), a + int(rng.geometric(0.2)))
        token = TOKENS[int(rng.integers(len(TOKENS)))]
        number = f"{rng.normal() * 10.0 ** rng.integers(-3, 4):.4g}".encode()
        match int(rng.choice(len(CHANGES), p=CHANGES)):
            case 0:
                text[a:b] = bytes(rng.integers(32, 127, b - a, dtype=np.uint8))
            case 1:
                text[a:b] = bytes(rng.integers(0, 256, b - a, dtype=np.uint8))
            case 2:
                del text[a:b]
            case 3:
                text[a:a] = text[a:b] * int(rng.integers(1, 20))
            case 4:
                text[a:b] = token
            case 5:
                text[a:b] = number
            case 6:
                digits = [i for i in range(a, min(a + 60, len(text))) if 48 <= text[i] <= 57]
                for i in digits[:1]:
                    text[i] = int(rng.integers(48, 58))
            case 7:
                lines = text.split(b"\n")
                i, k = rng.integers(0, len(lines), 2).tolist()
                lines[i], lines[k] = lines[k], lines[i]
                text = bytearray(b"\n".join(lines))
            case 8:
                piece = token if rng.random() < 0.5 else bytes(text[a:b]) or token
                text[a:a] = piece * (LONGEST_REPEAT // len(piece))
            case _:
                del text[b:]
        if not text:
            text += token
        del text[LARGEST_FILE:]
    return bytes(text)


def run(seed: int) -> Outcome:
    """Read a broken file, within limits of time and memory."""
    kind = list(KINDS)[seed % len(KINDS)]

    def interrupt_reading(*_: object) -> None:
        raise TooSlow

    signal.signal(signal.SIGALRM, interrupt_reading)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        outcome = read(kind, seed // len(KINDS))
    except TooSlow:
        return Outcome(kind=kind, result="slow", notes=[f"more than {LONGEST:g} s"])
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    if grown > LARGEST:
        return Outcome(kind=kind, result="large", notes=[f"{grown / 1e6:.0f} MB more"])
    return outcome


def read(kind: str, seed: int) -> Outcome:
    """Read one broken file."""
    rng = np.random.default_rng([seed, len(kind), ord(kind[0])])
    sample_files = samples(kind)
    data = mutated(sample_files[int(rng.integers(len(sample_files)))], rng)
    name = f"part{KINDS[kind]}"
    notes = []
    how = ReadOptions(
        units=None if rng.random() < 0.5 else 1e-3,
        unknown="refuse" if rng.random() < 0.5 else "skip",
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            length, names = _read_as(kind, name, data, how)
    except ac.InvalidInput as error:
        if not str(error).isprintable() or len(str(error)) > LONGEST_SENTENCE:
            notes.append(f"the sentence {str(error)[:LONGEST_SENTENCE]!r}")
        if name not in str(error):
            notes.append(f"does not name the file: {error}")
        return Outcome(kind=kind, result="refused", notes=notes)
    if not np.isfinite(length):
        notes.append("a length that is not finite")
    odd = [x for x in names if not x.isprintable() or len(x) > LONGEST_NAME]
    notes += [f"the name {x!r}" for x in odd[:1]]
    return Outcome(kind=kind, result="read", notes=notes)


def _read_as(kind: str, name: str, data: bytes, how: ReadOptions) -> tuple[float, list[str]]:
    """Read a file; return the length of its content [m], and all names in it."""
    if kind in BODIES:
        return _read_bodies(kind, name, data)
    if kind == "job":
        from armcontour.files import parse_job

        job = parse_job(data.decode("utf-8", errors="replace"), source=name)
        path = job.path
        if isinstance(path, ac.Path):
            return path.length, [job.name]
    else:
        module, function = READERS[KINDS[kind]]
        reader: Any = getattr(
            importlib.import_module(f"armcontour.files.drawings.{module}"), function
        )
        path = reader(data, source=name, options=how)
    names = [text for x in path.contours for text in (x.name, x.layer)]
    return path.length, [*names, *(e.name for x in path.contours for e in x.events)]


def _read_bodies(kind: str, name: str, data: bytes) -> tuple[float, list[str]]:
    """Read bodies; return their largest size [m], and all names in them."""
    from armcontour.files.mesh_file import read_mesh
    from armcontour.files.robots.collision_shapes import excluded_pairs_of, link_shapes
    from armcontour.files.robots.urdf_chain import Description
    from armcontour.files.robots.urdf_tree import read_tree

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(data)
        if kind == "Srdf":
            ignored = excluded_pairs_of(data, file, ["base", "beam", "camera"])
            return 0.0, [text for x in ignored for text in (x.first, x.second)]
        if kind in ("stl", "obj"):
            return read_mesh(file).size, []
        tree = read_tree(str(file), data)
        bodies = link_shapes(tree, Description(tree, (), (), tree.root).link_frames())
    sizes = [np.abs(x.place.position).max() for x in bodies]
    return float(max(sizes, default=0.0)), [x.name for x in bodies]
