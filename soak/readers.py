"""`python -m soak.readers`: read many broken files; exit code 1 if a reader does not bear one.

What a reader may do with a file is to read it, or to refuse it with a sentence that names it; soon,
and with little memory.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import armcontour as ac
from armcontour._checks import LONGEST_NAME
from armcontour._text import LONGEST_SENTENCE
from armcontour.io.drawings.endings import READERS
from armcontour.io.drawings.reading import Reading
from soak.samples import samples

KINDS = {
    "dxf": ".dxf",
    "svg": ".svg",
    "gcode": ".ngc",
    "csv": ".csv",
    "job": ".yaml",
    "stl": ".stl",
    "obj": ".obj",
    "scene": ".scene",
    "urdf": ".urdf",
    "Srdf": ".srdf",
}
# Files of bodies, which are read from a folder.
BODIES = ("stl", "obj", "scene", "urdf", "Srdf")
# A file of a few kilobytes is not worth more [s], [bytes].
LONGEST = 20.0
LARGEST = 600e6
# How often each kind of change is made.
CHANGES = (0.06, 0.02, 0.1, 0.06, 0.12, 0.12, 0.38, 0.1, 0.02, 0.02)
# Characters of a piece that is repeated until a pattern that goes back would not end.
LONGEST_REPEAT = 60_000
LARGEST_FILE = 200_000
CHUNK = 100
# What breaks readers, beside noise.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of a file: "read", "refused", "crash", "nameless", "slow" or "large"."""

    kind: str
    seed: int
    result: str
    note: str = ""

    @property
    def failed(self) -> bool:
        """Whether the reader did not bear it."""
        return self.result not in ("read", "refused")


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """The file with some of it changed, lost, doubled, moved, or replaced by what is nasty.

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


def read(kind: str, seed: int) -> Outcome:
    """Read one broken file."""
    rng = np.random.default_rng([seed, len(kind), ord(kind[0])])
    of = samples(kind)
    data = mutated(of[int(rng.integers(len(of)))], rng)
    name = f"part{KINDS[kind]}"
    how = Reading(
        unit=None if rng.random() < 0.5 else 1e-3,
        unknown="refuse" if rng.random() < 0.5 else "skip",
    )
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result, note = _result(kind, name, data, how)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    if grown > LARGEST:
        result, note = "large", f"{grown / 1e6:.0f} MB more"
    return Outcome(kind=kind, seed=seed, result=result, note=note)


def _result(kind: str, name: str, data: bytes, how: Reading) -> tuple[str, str]:
    def late(*_: object) -> None:
        raise TooSlow

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            length, names = _read_as(kind, name, data, how)
        if not np.isfinite(length):
            return "crash", "a length that is not finite"
        odd = [x for x in names if not x.isprintable() or len(x) > LONGEST_NAME]
        if odd:
            return "crash", f"the name {odd[0]!r}"
    except ac.InvalidInput as error:
        if not str(error).isprintable() or len(str(error)) > LONGEST_SENTENCE:
            return "crash", f"the sentence {str(error)[:LONGEST_SENTENCE]!r}"
        named = name in str(error)
        return ("refused", str(error)) if named else ("nameless", str(error))
    except TooSlow:
        return "slow", f"more than {LONGEST:g} s"
    except Exception as error:
        return "crash", f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return "read", ""


def _read_as(kind: str, name: str, data: bytes, how: Reading) -> tuple[float, list[str]]:
    """Length of what is read [m], and all names in it."""
    import importlib

    if kind in BODIES:
        return _read_bodies(kind, name, data)
    if kind == "job":
        from armcontour.io import parse_job

        job = parse_job(data.decode("utf-8", errors="replace"), source=name)
        path = job.path
        if isinstance(path, ac.Path):
            return path.length, [job.name]
    else:
        module, function = READERS[KINDS[kind]]
        reader: Any = getattr(importlib.import_module(f"armcontour.io.drawings.{module}"), function)
        path = reader(data, source=name, reading=how)
    names = [text for x in path.contours for text in (x.name, x.layer)]
    return path.length, [*names, *(e.name for x in path.contours for e in x.events)]


def _read_bodies(kind: str, name: str, data: bytes) -> tuple[float, list[str]]:
    """Largest size of what is read [m], and all names in it."""
    from armcontour.io.mesh_file import read_mesh
    from armcontour.io.robots.srdf import read_left_out
    from armcontour.io.scene_files import read_scene_file

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(data)
        if kind == "Srdf":
            left = read_left_out(file, ["base", "beam", "camera"])
            return 0.0, [text for x in left for text in (x.first, x.second)]
        if kind in ("stl", "obj"):
            return read_mesh(file).size, []
        found = read_scene_file(file)
    sizes = [np.abs(x.place.position).max() for x in found]
    return float(max(sizes, default=0.0)), [x.name for x in found]


def _read_all(kind: str, seeds: range) -> tuple[list[Outcome], float]:
    begin = time.monotonic()
    return [read(kind, seed) for seed in seeds], time.monotonic() - begin


def main() -> int:
    """Run the soak; returns the exit code."""
    from rich.console import Console
    from rich.progress import track

    parser = argparse.ArgumentParser(prog="python -m soak.readers", description=__doc__)
    parser.add_argument("--count", type=int, default=20_000, help="files per reader")
    parser.add_argument("--first-seed", type=int, default=0, help="seed of the first one")
    parser.add_argument("--reader", choices=KINDS, action="append", help="only this reader")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    given = parser.parse_args()
    console = Console()
    failed = 0
    last = given.first_seed + given.count
    with ProcessPoolExecutor(given.jobs) as pool:
        for kind in given.reader or KINDS:
            chunks = [range(a, min(a + CHUNK, last)) for a in range(given.first_seed, last, CHUNK)]
            counts: Counter[str] = Counter()
            seconds = 0.0
            found = pool.map(_read_all, [kind] * len(chunks), chunks)
            for outcomes, took in track(found, kind, len(chunks), console=console):
                seconds += took
                for x in outcomes:
                    counts[x.result] += 1
                    if x.failed:
                        failed += 1
                        console.print(
                            f"{kind} seed {x.seed} {x.result}: {x.note}",
                            markup=False,
                            highlight=False,
                            soft_wrap=True,
                        )
            console.print(
                f"{kind}: {dict(counts)}, {seconds / given.count * 1e3:.1f} ms a file",
                highlight=False,
            )
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
