"""The code on the pages: its blocks, and how a reader does a page, step by step.

HTML comments before a block say what the page's text says in words:

- `<!-- file: NAME -->`: the block is the content of that file;
- `<!-- continues README.md -->`: the page goes on with the names of another page's Python;
- `<!-- not run: REASON -->`: the block is not run;
- `<!-- needs: NAME, NAME -->`: from here on the reader has these sample files of `examples`;
- `<!-- exit code: 3 -->`: the commands of the block end with this code, others with 0;
- `<!-- within: 1 % -->`: figures of this output may differ by that share.

A block `sh` holds command lines that are run. A block `text` holds what the block before it prints.
"""

from __future__ import annotations

import io
import re
import shlex
import shutil
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any
from unittest import mock

from markdown_it import MarkdownIt

from armcontour.cli import main

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "examples"
MARK = re.compile(
    r"<!-- (file|not run|needs|exit code|within): (.+?) -->|<!-- (continues) (.+?) -->"
)
# A number in an output; digits within a word, such as those of a file's name, are none.
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")
# What tables are framed with.
FRAME = re.compile("[\u2500-\u257f]+")
ANY = "..."
# Two printed numbers agree if they differ by one unit of the last digit: a value between two of
# them may come out as either. Counts agree exactly.
UNITS = 1.0001


@dataclass
class Block:
    """A fenced block of a page: its language, its text, the line of that, and the marks before."""

    page: str
    language: str
    text: str
    line: int
    marks: dict[str, str]

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks(file: Path) -> Iterator[Block]:
    """The blocks of a page.

    Args:
        file: The page.
    """
    marks: dict[str, str] = {}
    page = file.relative_to(ROOT).as_posix()
    for token in MarkdownIt().parse(file.read_text(encoding="utf-8")):
        if token.type == "html_block":
            matches = MARK.findall(token.content)
            marks |= {kind or other: text or language for kind, text, other, language in matches}
        elif token.type == "fence":
            assert token.map is not None
            yield Block(page, token.info.strip(), token.content, token.map[0] + 2, marks)
            marks = {}
        else:
            assert not marks, f"{page}: {marks} stands before no block"


def read_page(file: Path) -> Iterator[tuple[Block, str]]:
    """Do a page in the present folder: give each block of output with what was really printed.

    Args:
        file: The page.
    """
    names: dict[str, Any] = {"__name__": file.stem}
    printed: str | None = None
    for block in blocks(file):
        for name in filter(None, block.marks.get("needs", "").split(", ")):
            shutil.copy(next(SAMPLES.glob(f"*/{name}")), name)
        if "not run" in block.marks:
            continue
        if "file" in block.marks:
            Path(block.marks["file"]).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            printed = run_python(block, names)
        elif block.language == "sh":
            printed = run_commands(block)
        elif block.language == "text":
            assert printed is not None, f"{block}: output of nothing"
            yield block, printed
            printed = None


def run_python(block: Block, names: dict[str, Any]) -> str:
    """Run Python with the names of the blocks before it; returns what it prints.

    Args:
        block: The block.
        names: Names that are known; those that it makes are added.
    """
    code = "\n" * (block.line - 1) + block.text
    with redirect_stdout(io.StringIO()) as out:
        exec(compile(code, str(ROOT / block.page), "exec"), names)
    return out.getvalue()


def run_commands(block: Block) -> str:
    """Run command lines; returns what they print, with their errors.

    Args:
        block: The block.

    Raises:
        AssertionError: One ends with another exit code than the page says.
    """
    expected = int(block.marks.get("exit code", "0"))
    printed = ""
    for line in block.text.replace("\\\n", " ").splitlines():
        program, *arguments = shlex.split(line, comments=True)
        assert program == "armcontour", f"{block}: {line}"
        code, out, errors = run_command(arguments)
        assert code == expected, f"{block}: {line} ends with {code}: {errors}"
        # What is compiled, and how far work is, is told on the standard error, too.
        printed += out + "".join(x for x in errors.splitlines(True) if x.startswith("Error: "))
    return printed


def run_command(arguments: Sequence[str]) -> tuple[int, str, str]:
    """Run the command line in this process; returns exit code, output and errors.

    Args:
        arguments: Words of the command line after the program.
    """
    out = io.StringIO()
    errors = io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["armcontour", *arguments]),
        mock.patch.object(signal, "signal", lambda *_: None),
        redirect_stdout(out),
        redirect_stderr(errors),
    ):
        try:
            main()
        except SystemExit as ended:
            code = ended.code or 0
    assert isinstance(code, int)
    return code, out.getvalue(), errors.getvalue()


def agree(expected: str, printed: str, *, within: float = 0.0) -> bool:
    """Whether an output is that of the page.

    Words have to be the same, however they are spaced or framed, and so have counts. Numbers with
    decimals may differ by one unit of their last digit. `...` in the page's output stands for any
    words, or for a part of a word.

    Args:
        expected: What the page says.
        printed: What was printed.
        within: Share by which numbers with decimals may differ besides.
    """
    expected_words, printed_words = (FRAME.sub(" ", x).split() for x in (expected, printed))
    # The usual matching of wildcards: the last one takes a word more where the rest does not fit.
    i = k = 0
    last: tuple[int, int] | None = None
    while k < len(printed_words):
        if i < len(expected_words) and expected_words[i] == ANY:
            last = (i, k)
            i += 1
        elif i < len(expected_words) and _same_word(expected_words[i], printed_words[k], within):
            i = i + 1
            k = k + 1
        elif last is not None:
            last = (last[0], last[1] + 1)
            i = last[0] + 1
            k = last[1]
        else:
            return False
    return all(x == ANY for x in expected_words[i:])


def _same_word(expected: str, printed: str, within: float) -> bool:
    """Whether a word is that of the page, with its numbers."""
    if ANY in expected:
        return re.fullmatch(".*".join(map(re.escape, expected.split(ANY))), printed) is not None
    if NUMBER.sub("#", expected) != NUMBER.sub("#", printed):
        return False
    pairs = zip(NUMBER.findall(expected), NUMBER.findall(printed), strict=True)
    return all(_same_number(x, y, within) for x, y in pairs)


def _same_number(expected: str, printed: str, within: float) -> bool:
    """Whether a number is that of the page."""
    last = Decimal(expected).as_tuple().exponent
    if last == 0:
        return expected == printed
    unit = UNITS * 10.0 ** float(last)
    return abs(float(printed) - float(expected)) <= unit + within * abs(float(expected))
