"""Blocks of code on pages, which tests run as a reader would run them.

HTML comments before a block tell the tests what the page tells its reader:

- `<!-- file: NAME -->`: the block is the content of this file;
- `<!-- continues README.md -->`: the block uses the Python names of another page;
- `<!-- not run: REASON -->`: the block is not run;
- `<!-- needs: NAME, NAME -->`: from here on, the folder contains these files of `examples`;
- `<!-- exit code: 3 -->`: the commands of the block end with this code, others with 0;
- `<!-- within: 1 % -->`: numbers of this output may differ by this fraction.

A block `sh` contains commands, which are run. A block `text` contains the output of the block
before it.
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
# A number in an output; digits in a word, such as in a file name, are not numbers.
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")
# Characters that draw the frames of tables.
FRAME = re.compile("[\u2500-\u257f]+")
ANY = "..."
# Numbers with decimals agree if they differ by at most one unit of the last digit, because rounding
# errors may change this digit. The excess allows for the rounding error of the difference. Whole
# numbers must be equal.
LARGEST_DIFFERENCE = 1.0001  # Units of the last digit


@dataclass
class Block:
    """Fenced block of a page: language, text, line of the text, and marks before the block."""

    page: str
    language: str
    text: str
    line: int
    marks: dict[str, str]

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks(file: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a page.

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
    """Run a page in the current folder; yield each block of output with the actual output.

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
    """Run a block of Python with the names of earlier blocks; return its output.

    Args:
        block: The block.
        names: Names of earlier blocks; the names that this block defines are added.
    """
    code = "\n" * (block.line - 1) + block.text
    with redirect_stdout(io.StringIO()) as out:
        exec(compile(code, str(ROOT / block.page), "exec"), names)
    return out.getvalue()


def run_commands(block: Block) -> str:
    """Run the commands of a block; return their output and their errors.

    Args:
        block: The block.

    Raises:
        AssertionError: A command has another exit code than the page states.
    """
    expected = int(block.marks.get("exit code", "0"))
    printed = ""
    for line in block.text.replace("\\\n", " ").splitlines():
        program, *arguments = shlex.split(line, comments=True)
        assert program == "armcontour", f"{block}: {line}"
        code, out, errors = run_command(arguments)
        assert code == expected, f"{block}: {line} ends with {code}: {errors}"
        # The standard error also contains messages about compilation and progress.
        printed += out + "".join(x for x in errors.splitlines(True) if x.startswith("Error: "))
    return printed


def run_command(arguments: Sequence[str]) -> tuple[int, str, str]:
    """Run armcontour in this process; return exit code, output and errors.

    Args:
        arguments: Arguments of the command line, without the name of the program.
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
    """Return whether an output agrees with the output that the page states.

    Words and whole numbers must be equal; spaces and frames of tables are ignored. Numbers with
    decimals may differ by one unit of their last digit. `...` on the page stands for any words, or
    for a part of a word.

    Args:
        expected: Output that the page states.
        printed: Actual output.
        within: Fraction by which numbers with decimals may differ in addition.
    """
    expected_words, printed_words = (FRAME.sub(" ", x).split() for x in (expected, printed))
    # If a word does not match, the last `...` is extended by one word, and the comparison restarts
    # after it. `last_any`: indices of the last `...` and of the first printed word after it.
    i = k = 0
    last_any: tuple[int, int] | None = None
    while k < len(printed_words):
        if i < len(expected_words) and expected_words[i] == ANY:
            last_any = (i, k)
            i += 1
        elif i < len(expected_words) and _same_word(expected_words[i], printed_words[k], within):
            i = i + 1
            k = k + 1
        elif last_any is not None:
            last_any = (last_any[0], last_any[1] + 1)
            i = last_any[0] + 1
            k = last_any[1]
        else:
            return False
    return all(x == ANY for x in expected_words[i:])


def _same_word(expected: str, printed: str, within: float) -> bool:
    """Return whether a printed word, including its numbers, agrees with a word of the page."""
    if ANY in expected:
        return re.fullmatch(".*".join(map(re.escape, expected.split(ANY))), printed) is not None
    if NUMBER.sub("#", expected) != NUMBER.sub("#", printed):
        return False
    pairs = zip(NUMBER.findall(expected), NUMBER.findall(printed), strict=True)
    return all(_same_number(x, y, within) for x, y in pairs)


def _same_number(expected: str, printed: str, within: float) -> bool:
    """Return whether a printed number agrees with a number of the page."""
    exponent = Decimal(expected).as_tuple().exponent
    if exponent == 0:
        return expected == printed
    tolerance = LARGEST_DIFFERENCE * 10.0 ** float(exponent) + within * abs(float(expected))
    return abs(float(printed) - float(expected)) <= tolerance
