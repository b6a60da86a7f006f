"""Words of G-code lines, and messages about them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from armcontour.core.text import count_noun, list_some
from armcontour.files.drawings.gcode.codes import (
    BARE_WORDS,
    G_GROUP,
    M_GROUP,
    MOTION,
    PLAIN_MOVES,
    UNDERSTOOD_M,
    g_name,
)

MILLIMETRE, INCH = 1e-3, 0.0254
IDLE = "Skipped because it causes no motion: {}."
# Largest number of kinds that a note names.
MAX_KINDS = 12


class Fault(Exception):
    """An error in a line; the text completes a sentence that names the line."""

    def __init__(self, text: str, *lengths: float, line: int = 0) -> None:
        super().__init__(text)
        self.lengths, self.line = lengths, line

    def message(self, *, inch: bool) -> str:
        """The words with the lengths, in inches or in millimetres."""
        text = str(self)
        if not self.lengths:
            return text
        unit, name = (INCH, "inch") if inch else (MILLIMETRE, "mm")
        return text.format(*(f"{x / unit:.6g} {name}" for x in self.lengths))


class Notes:
    """Notes on skipped content and on the interpretation of lines, with the current line."""

    def __init__(self) -> None:
        self.line = 0
        # Count and first line of each kind, by the sentence; first lines by the sentence.
        self.counts: dict[str, dict[str, list[int]]] = {IDLE: {}}
        self.firsts: dict[str, int] = {}

    def count(self, kind: str, sentence: str = IDLE) -> None:
        """Count a skipped item; `{}` in the sentence is replaced by all kinds."""
        self.counts.setdefault(sentence, {}).setdefault(kind, [0, self.line])[0] += 1

    def once(self, sentence: str) -> None:
        """Note how lines are read; `{}` in the sentence is replaced by the first such line."""
        self.firsts.setdefault(sentence, self.line)

    def sentences(self) -> list[str]:
        """All notes."""
        listed = {
            sentence: list_some(
                [
                    f"{x} ({count_noun(n, 'time')}, first in line {i})"
                    for x, (n, i) in kinds.items()
                ],
                MAX_KINDS,
            )
            for sentence, kinds in self.counts.items()
        }
        counted = [sentence.format(x) for sentence, x in listed.items() if x]
        return counted + [sentence.format(line) for sentence, line in self.firsts.items()]


# Seventeen digits distinguish all doubles; longer numbers are not meaningful.
MAX_CHARACTERS = 34
# Largest value of any word; coordinates have a separate limit.
LARGEST_VALUE = 1e9
# A program has lines of some ten characters, and comments of some hundred.
LONGEST_LINE = 65_536
# Number of characters of refused text in messages.
SHOWN = 30
# Smaller M codes have no decimals.
FIRST_WITH_DECIMALS = 100
# A value this near to a whole number is whole (LinuxCNC manual, "Numbers").
WHOLE = 1e-4

TOKEN = re.compile(r"([A-Z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))|\([^()]*\)|;.*", re.DOTALL)
EXPONENT = re.compile(r"[0-9.][eE]")
COMMENTS = re.compile(r"\([^()]*\)|;.*", re.DOTALL)
# The start of an O word, and an O word that is a program number.
O_WORD = re.compile(r"(?:N[0-9]+)?O")
PROGRAM_NUMBER = re.compile(r"(?:N[0-9]+)?O[0-9]+(?:\.0*)?")
# Flow control of Fanuc.
FANUC_FLOW = re.compile(r"IF|WHILE|GOTO|END|DO|ELSE|THEN")
# Expressions, and words with expressions as values: #1=2, X#1, Y-[2*#1], ZSIN[30].
COMPUTED = re.compile(r"[A-Z]?[-+]*(?:#|[A-Z]*\[)")
# Letters without a value, and text, which 3D printers have: G28 X Y, M84 X Y E, M862.3 P "MK3S".
BARE = re.compile(r"[A-Z](?=[A-Z(;\"]|$)")
TEXT = re.compile(r'"[^"]*"')
# Codes of a laser, which may have a letter I.
LASER = frozenset({3, 4, 5})
# The sum of bytes that senders of 3D printers add to numbered lines: "N3 T0*57".
CHECKSUM = re.compile(r"^(N[0-9]+[^;(*]*)\*[0-9]+(?=;|$)")
# Spaces are allowed anywhere, and case is ignored (LinuxCNC manual, "Format of a line").
COMPACT = str.maketrans(
    {c: None for c in " \t\r\n"} | {chr(i): chr(i - 32) for i in range(ord("a"), ord("z") + 1)}
)
TOOL_CHANGE = re.compile(r"[mM][ \t]*0*6(?![0-9.])")
# A move with a word E, which feeds material.
EXTRUSION = re.compile(r"[gG]0?[123](?![0-9.])[^mM;(]*(?<![a-zA-Z])[eE]-?[0-9.]")
# Codes that only programs of printers have: modes of E, and temperatures of nozzle and bed.
PRINTER = re.compile(r"[mM](?:8[23]|1[04][49]|140|190)(?![0-9.])")


class Block:
    """The words of a line."""

    __slots__ = ("before_m", "g", "m", "motion", "words")

    def __init__(self) -> None:
        self.g: list[int] = []
        self.motion: int | None = None
        self.m: list[float] = []
        self.words: dict[str, float] = {}
        self.before_m = 0

    def drop(self, letters: Iterable[str]) -> None:
        """Remove the words with these letters, if the line has them."""
        for letter in letters:
            self.words.pop(letter, None)


def parse(line: str) -> Block:
    """The words of a line."""
    text = line.translate(COMPACT)
    block = Block()
    if "O" in text and O_WORD.match(text) is not None:
        _check_program_number(line)
        return block
    position = 0
    while position < len(text):
        match = TOKEN.match(text, position)
        if match is None:
            position = _read_other(block, text, position)
            continue
        if match[1] is not None:
            _add(block, match[1], match[2], position)
        position = match.end()
        if text[position : position + 1] == "*" and (summed := CHECKSUM.match(text)) is not None:
            position = summed.end()
    if "E" in block.words and EXPONENT.search(COMMENTS.sub(" ", line)):
        raise Fault(
            "a number with an exponent, which G-code does not have: write it out, or a space "
            "before an E that is a word"
        )
    return block


def _check_program_number(line: str) -> None:
    """Check that an O word is the number of a program."""
    text = COMMENTS.sub("", line)
    if PROGRAM_NUMBER.fullmatch(text.translate(COMPACT)) is None:
        shown = " ".join(text.split())[:SHOWN]
        raise Fault(f"{ascii(shown)[1:-1]}: flow control is not read; {PLAIN_MOVES}")


def _read_other(block: Block, text: str, position: int) -> int:
    """Read a letter without a value, or text; returns its end."""
    # Marlin: an I without a value after M3, M4 or M5 selects laser power that changes with moves,
    # for example M3 S20 I.
    if text[position] == "I" and not LASER.isdisjoint(block.m) and BARE.match(text, position):
        _add_word(block, "I", math.nan)
        return position + 1
    strange = any(x not in UNDERSTOOD_M for x in block.m)
    if strange and (match := TEXT.match(text, position)) is not None:
        return match.end()
    bare = strange or not BARE_WORDS.isdisjoint(block.g)
    if bare and BARE.match(text, position):
        _add_word(block, text[position], math.nan)
        return position + 1
    raise Fault(_explain_syntax_error(text, position))


def _add(block: Block, letter: str, number: str, position: int) -> None:
    if len(number) > MAX_CHARACTERS:
        raise Fault(
            f"the number after {letter} has {len(number)} characters, but at most "
            f"{MAX_CHARACTERS} are read: round it"
        )
    if letter == "N":
        if position or number[0] in "+-":
            raise Fault("a line number N that is not a plain number at the start of the line")
        return
    text, value = letter + number, float(number)
    if abs(value) > LARGEST_VALUE:
        raise Fault(f"{text} is beyond {LARGEST_VALUE:g}, the largest value that is read")
    if letter == "G":
        _add_g(block, value, text)
    elif letter == "M":
        if not block.m:
            block.before_m = len(block.words)
        _add_m(block.m, value, text)
    else:
        _add_word(block, letter, value)


def _add_word(block: Block, letter: str, value: float) -> None:
    if letter in block.words:
        raise Fault(f"the word {letter} twice, of which only one can be meant")
    block.words[letter] = value


def _add_g(block: Block, value: float, text: str) -> None:
    codes, code = block.g, round(value * 10)
    if code < 0 or abs(value * 10 - code) > WHOLE:
        raise Fault(f"{text} is no G code")
    group = G_GROUP.get(code)
    for other in codes:
        if other == code or (group is not None and G_GROUP.get(other) == group):
            # G80 on the safe start line of a program: G0 G17 G40 G49 G80 G90.
            if group == MOTION and 800 in (other, code) and min(other, code) <= 10:
                codes.remove(other)
                code = min(other, code)
                break
            _raise_conflict(g_name(other), g_name(code), group)
    codes.append(code)
    if group == MOTION:
        block.motion = code


def _add_m(codes: list[float], value: float, text: str) -> None:
    # Printers have M codes with decimals, such as M862.3.
    code = round(value) if abs(value - round(value)) <= WHOLE else value
    if code < 0 or (code != round(code) and code < FIRST_WITH_DECIMALS):
        raise Fault(f"{text} is no M code")
    group = M_GROUP.get(code)
    for other in codes:
        if other == code or (group is not None and M_GROUP.get(other) == group):
            _raise_conflict(f"M{other:g}", f"M{code:g}", group)
    codes.append(code)


def _raise_conflict(first: str, second: str, group: str | None) -> None:
    group_name = f" of the group for {group}" if group else ""
    raise Fault(
        f"{first} and {second}, two codes{group_name} of which a line takes only one: "
        "write them in two lines"
    )


def whole_number(value: float, word: str) -> int:
    """Convert a value that must be a whole number."""
    if not math.isfinite(value) or abs(value - round(value)) > WHOLE:
        raise Fault(f"{word} of {value:g}, which must be a whole number")
    return round(value)


def _explain_syntax_error(text: str, position: int) -> str:
    """The reason why no word or comment starts at a position."""
    character = text[position]
    if FANUC_FLOW.match(text, position) is not None:
        return (
            f"{ascii(text[position : position + SHOWN])}: flow control is not read; {PLAIN_MOVES}"
        )
    if (match := COMPUTED.match(text, position)) is not None:
        kind = "a parameter #" if match[0].endswith("#") else "an expression [ ]"
        return (
            f"{kind} ({ascii(text[position : position + SHOWN])}), which is not read; {PLAIN_MOVES}"
        )
    if character == "(":
        inner = text.find("(", position + 1)
        close = text.find(")", position + 1)
        if close < 0 or inner < 0:
            return "a comment that begins with ( and does not end: close it with )"
        return "a comment ( ) within a comment: remove the inner parentheses"
    if text.startswith(("//", "/*"), position):
        return (
            f"a comment {text[position : position + 2]}, which G-code does not have: write ( ) or ;"
        )
    if character.isascii() and character.isalpha():
        return f"the letter {character} without a number after it"
    if character in "@^":
        return "polar coordinates (@ or ^), which this reader does not have: write X and Y"
    if character == "$":
        return "$, which belongs to a sender or a controller and is no G-code: remove the line"
    if text.startswith(("->", "<-", "<~")):
        return "the record of a sender (->, <-), which is no G-code: give the file of the program"
    return f"{ascii(character)}, which begins no word"


@dataclass(frozen=True, slots=True)
class Dialect:
    """Properties of a whole program."""

    changes_tools: bool  # Whether it has M6; otherwise T alone changes the tool
    extrudes: bool  # Whether some move feeds material
    printer: bool  # Whether it is a printer's, in which G4 P is in milliseconds


def dialect_of(lines: list[str]) -> Dialect:
    """The dialect of a program."""
    extrudes = _has(EXTRUSION, (x for x in lines if "E" in x or "e" in x))
    return Dialect(
        changes_tools=_has(TOOL_CHANGE, (x for x in lines if "6" in x)),
        extrudes=extrudes,
        printer=extrudes or _has(PRINTER, (x for x in lines if "M" in x or "m" in x)),
    )


def _has(pattern: re.Pattern[str], lines: Iterable[str]) -> bool:
    """True if a pattern occurs in a line outside of comments."""
    return any(
        pattern.search(COMMENTS.sub("", x)) is not None for x in lines if len(x) <= LONGEST_LINE
    )
