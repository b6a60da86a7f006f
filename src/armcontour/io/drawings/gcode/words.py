"""A line of G-code taken apart into its words."""

from __future__ import annotations

import re

from armcontour.io.drawings.gcode.codes import G_GROUP, M_GROUP, g_name

# Seventeen digits tell all doubles apart; twice as many are no measure of anything.
MOST_CHARACTERS = 34
# Largest value of a word, whatever it means; coordinates have a limit of their own.
LARGEST_VALUE = 1e9
# A value that is to be a whole number is one this near to it (LinuxCNC manual, "Numbers").
WHOLE = 1e-4

TOKEN = re.compile(r"([A-Z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))|\([^()]*\)|;.*", re.DOTALL)
EXPONENT = re.compile(r"[0-9.][eE]")
COMMENTS = re.compile(r"\([^()]*\)|;.*", re.DOTALL)
# Spaces may stand anywhere, and case means nothing (LinuxCNC manual, "Format of a line").
COMPACT = str.maketrans(
    {c: None for c in " \t\r\n"} | {chr(i): chr(i - 32) for i in range(ord("a"), ord("z") + 1)}
)


class Fault(Exception):
    """What is wrong with a line, as the second half of a sentence that names the line."""


class Block:
    """The words of a line: G codes in tenths, M codes, and a value for every other letter."""

    __slots__ = ("g", "m", "words")

    def __init__(self) -> None:
        self.g: list[int] = []
        self.m: list[int] = []
        self.words: dict[str, float] = {}


def parse(line: str) -> Block:
    """The words of a line.

    Raises:
        Fault: Something that is no word or comment, or words that exclude each other.
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
        raise Fault(f"the word {letter} twice, of which only one can be meant")
    else:
        block.words[letter] = value


def _add_code(
    codes: list[int], letter: str, number: str, scaled: float, groups: dict[int, str]
) -> None:
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
    """Why no word or comment begins there."""
    here = text[at]
    following = text[at + 1 : at + 2]
    if here in "#[]=" or (here.isascii() and here.isalpha() and following in ("#", "[")):
        return (
            "a parameter or an expression (# or [ ]), which this reader does not work out: let "
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
