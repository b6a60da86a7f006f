"""Parsing of a line of G-code into its words."""

from __future__ import annotations

import re

from armcontour.io.drawings.gcode.codes import G_GROUP, M_GROUP, g_name

# Longest number [characters]: seventeen digits are enough for any double.
MOST_CHARACTERS = 34
# Largest value of any word; coordinates have a smaller limit.
LARGEST_VALUE = 1e9
# A value counts as a whole number if it differs by at most this (LinuxCNC manual, "Numbers").
WHOLE = 1e-4

TOKEN = re.compile(r"([A-Z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))|\([^()]*\)|;.*", re.DOTALL)
EXPONENT = re.compile(r"[0-9.][eE]")
COMMENTS = re.compile(r"\([^()]*\)|;.*", re.DOTALL)
# Spaces may be anywhere and case is ignored (LinuxCNC manual, "Format of a line"): this table
# removes spaces and converts letters to capitals.
COMPACT = str.maketrans(
    {c: None for c in " \t\r\n"} | {chr(i): chr(i - 32) for i in range(ord("a"), ord("z") + 1)}
)


class Fault(Exception):
    """An error in a line; the message completes a sentence that starts with the line's number."""


class Block:
    """The words of a line.

    Attributes:
        g: G codes, times ten.
        m: M codes.
        words: Values of the other words by their letters.
    """

    __slots__ = ("g", "m", "words")

    def __init__(self) -> None:
        self.g: list[int] = []
        self.m: list[int] = []
        self.words: dict[str, float] = {}


def parse(line: str) -> Block:
    """Parse a line into its words.

    Raises:
        Fault: The line has something other than words and comments, or words that exclude each
            other.
    """
    text = line.translate(COMPACT)
    block = Block()
    at = 0
    while at < len(text):
        found = TOKEN.match(text, at)
        if found is None or found[1] == "O":
            raise Fault(_what_is_wrong(text, at))
        if found[1] is not None:
            _add(block, found[1], found[2], at)
        at = found.end()
    if "E" in block.words and EXPONENT.search(COMMENTS.sub(" ", line)):
        raise Fault(
            "a number with an exponent, which G-code does not have: write it out, or a space "
            "before an E that is a word"
        )
    return block


def _add(block: Block, letter: str, number: str, at: int) -> None:
    """Add a word to a block; `at` is its position in the line.

    Raises:
        Fault: The value is out of range, or the word excludes another one of the line.
    """
    if len(number) > MOST_CHARACTERS:
        raise Fault(
            f"the number after {letter} has {len(number)} characters, but at most "
            f"{MOST_CHARACTERS} are read: round it"
        )
    value = float(number)
    if letter == "N":
        if at or number[0] in "+-":
            raise Fault("a line number N that is not a plain number at the start of the line")
    elif abs(value) > LARGEST_VALUE:
        raise Fault(f"{letter}{number} is beyond {LARGEST_VALUE:g}, the largest value that is read")
    elif letter == "G":
        _add_code(block.g, "G", number, value * 10, G_GROUP)
    elif letter == "M":
        _add_code(block.m, "M", number, value, M_GROUP)
    elif letter in block.words:
        raise Fault(f"the word {letter} twice, which a line takes only once")
    else:
        block.words[letter] = value


def _add_code(
    codes: list[int], letter: str, number: str, scaled: float, groups: dict[int, str]
) -> None:
    """Add a G or M code to the codes of a line.

    Args:
        codes: The codes of the line.
        letter: "G" or "M".
        number: The number as written, for messages.
        scaled: The number in the unit of `codes`.
        groups: Modal groups by code.

    Raises:
        Fault: The code is invalid, or a code of the same modal group is in the line.
    """
    code = round(scaled)
    if code < 0 or abs(scaled - code) > WHOLE:
        raise Fault(f"{letter}{number} is no {letter} code")
    group = groups.get(code)
    for other in codes:
        if other == code or (group is not None and groups.get(other) == group):
            name = g_name if letter == "G" else "M{}".format
            what = f" of the group for {group}" if group else ""
            raise Fault(
                f"{name(other)} and {name(code)}, two codes{what} of which a line takes only one: "
                "write them in two lines"
            )
    codes.append(code)


def _what_is_wrong(text: str, at: int) -> str:
    """The reason why no word or comment starts at a position of a line."""
    here = text[at]
    following = text[at + 1 : at + 2]
    if here in "#[]=" or (here.isascii() and here.isalpha() and following in ("#", "[")):
        return (
            "a parameter or an expression (# or [ ]), which this reader does not evaluate: let "
            "the program that wrote the file write plain numbers"
        )
    if here == "O":
        return (
            "an O word, that is a subroutine, a loop or a program number, which this reader does "
            "not follow: write the moves out"
        )
    if here == "(":
        inner = text.find("(", at + 1)
        close = text.find(")", at + 1)
        if close < 0 or inner < 0:
            return "a comment that begins with ( and does not end: close it with )"
        return "a comment ( ) within a comment: leave out the inner parentheses"
    if here.isascii() and here.isalpha():
        return f"the letter {here} without a number after it"
    if here in "@^":
        return "polar coordinates (@ or ^), which this reader does not have: write X and Y"
    return f"{ascii(here)}, which begins no word"
