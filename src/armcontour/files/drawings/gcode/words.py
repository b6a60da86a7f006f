"""Parser for the words of G-code lines, with the errors and notes of the reader."""

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
NO_MOTION_NOTE = "Skipped because it causes no motion: {}."
# Largest number of kinds that a note lists.
MAX_KINDS = 12


class Fault(Exception):
    """An error in a line; the text is a sentence without a full stop, shown after the line number.

    Each `{}` in the text is replaced by one of `lengths` [m] in the unit of the program.
    """

    def __init__(self, text: str, *lengths: float, line: int = 0) -> None:
        super().__init__(text)
        self.lengths, self.line = lengths, line

    def message(self, *, inch: bool) -> str:
        """The text of the error, with lengths in inches or in millimetres."""
        text = str(self)
        if not self.lengths:
            return text
        unit, name = (INCH, "inch") if inch else (MILLIMETRE, "mm")
        return text.format(*(f"{x / unit:.6g} {name}" for x in self.lengths))


class Notes:
    """Notes on skipped content and on the interpretation of lines, and the current line number."""

    def __init__(self) -> None:
        self.line = 0
        # Count and first line of each skipped kind, by note template and kind.
        self.counts: dict[str, dict[str, list[int]]] = {NO_MOTION_NOTE: {}}
        # First line that each note template of `add_once` applies to.
        self.firsts: dict[str, int] = {}

    def count(self, kind: str, sentence: str = NO_MOTION_NOTE) -> None:
        """Count a skipped item; `{}` in the sentence is replaced by the list of all kinds."""
        self.counts.setdefault(sentence, {}).setdefault(kind, [0, self.line])[0] += 1

    def add_once(self, sentence: str) -> None:
        """Note how lines are interpreted; `{}` is replaced by the number of the first such line."""
        self.firsts.setdefault(sentence, self.line)

    def sentences(self) -> list[str]:
        """All notes as complete sentences."""
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


# Maximum length of a number [characters]. Seventeen digits distinguish all doubles.
MAX_NUMBER_LENGTH = 34
# Largest absolute value of a word; coordinates have a separate limit in metres.
MAX_VALUE = 1e9
# Maximum length of a line [characters]; real programs need about ten, with comments some hundred.
MAX_LINE_LENGTH = 65_536
# Number of characters of rejected text that a message shows.
SHOWN_CHARACTERS = 30
# Smallest M code that may have decimals, such as M862.3 of 3D printers.
FIRST_WITH_DECIMALS = 100
# A value counts as a whole number if it differs from the nearest whole number by at most this
# (LinuxCNC manual, "Numbers").
WHOLE_TOLERANCE = 1e-4

# $ selects a spindle (LinuxCNC), unless it sets a parameter of grbl, as in $10=1.
TOKEN = re.compile(
    r"([A-Z]|\$(?![0-9]+=))([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))|\([^()]*\)|;.*", re.DOTALL
)
EXPONENT = re.compile(r"[0-9.][eE]")
COMMENTS = re.compile(r"\([^()]*\)|;.*", re.DOTALL)
# Matches the start of an O word.
O_WORD = re.compile(r"(?:N[0-9]+)?O")
# Matches an O word that is a program number, not flow control.
PROGRAM_NUMBER = re.compile(r"(?:N[0-9]+)?O[0-9]+(?:\.0*)?")
# Matches the keywords of Fanuc's flow control.
FANUC_FLOW = re.compile(r"IF|WHILE|GOTO|END|DO|ELSE|THEN")
# Matches parameters, and words with parameters or expressions as values: #1=2, X#1, ZSIN[30].
COMPUTED = re.compile(r"[A-Z]?[-+]*(?:#|[A-Z]*\[)")
# Matches assignments and calls of other dialects, such as X=10, CR=5, MSG("end") and CYCLE800.
FOREIGN = re.compile(r"=|[A-Z]+[0-9]*=|[A-Z]{2,}\(|[A-Z]{3,}")
# Matches a letter without a value and quoted text, as in programs of 3D printers: G28 X Y,
# M84 X Y E, M862.3 P "MK3S".
BARE_LETTER = re.compile(r"[A-Z](?=[A-Z(;\"]|$)")
QUOTED_TEXT = re.compile(r'"[^"]*"')
# M codes that may have a letter I without a value (Marlin: inline laser power).
LASER_CODES = frozenset({3, 4, 5})
# Matches a numbered line with the checksum that senders of 3D printers append: "N3 T0*57".
CHECKSUM = re.compile(r"^(N[0-9]+[^;(*]*)\*[0-9]+(?=;|$)")
# Removes white space and converts to capitals, because white space and case are ignored (LinuxCNC
# manual, "Format of a line").
TO_COMPACT = str.maketrans(
    {c: None for c in " \t\r\n"} | {chr(i): chr(i - 32) for i in range(ord("a"), ord("z") + 1)}
)
TOOL_CHANGE = re.compile(r"[mM][ \t]*0*6(?![0-9.])")
# Matches a move with a word E, which feeds material.
EXTRUSION = re.compile(r"[gG]0?[123](?![0-9.])[^mM;(]*(?<![a-zA-Z])[eE]-?[0-9.]")
# Matches codes of 3D printers only: modes of E, and temperatures of nozzle and bed.
PRINTER_CODE = re.compile(r"[mM](?:8[23]|1[04][49]|140|190)(?![0-9.])")


class Block:
    """The words of a line: G codes in tenths, M codes, and the other words by letter.

    `motion` is the G code of the modal group for motion, or None. `before_m` is the number of
    `words` before the first M code.
    """

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
    """Parse a line into its words. The block is empty for a comment or a program number."""
    text = line.translate(TO_COMPACT)
    block = Block()
    if "O" in text and O_WORD.match(text) is not None:
        _check_program_number(line)
        return block
    position = 0
    while position < len(text):
        match = TOKEN.match(text, position)
        if match is None:
            position = _read_bare_or_text(block, text, position)
            continue
        if match[1] is not None:
            _add(block, match[1], match[2], position)
        position = match.end()
        if text[position : position + 1] == "*" and (summed := CHECKSUM.match(text)) is not None:
            position = summed.end()
    if "E" in block.words and EXPONENT.search(COMMENTS.sub(" ", line)):
        raise Fault(
            "numbers with an exponent are not valid in G-code: write the number without an "
            "exponent, or write a space before E if E is a word"
        )
    return block


def _check_program_number(line: str) -> None:
    """Check that a line with an O word contains only the number of a program."""
    text = COMMENTS.sub("", line)
    if PROGRAM_NUMBER.fullmatch(text.translate(TO_COMPACT)) is None:
        shown = " ".join(text.split())[:SHOWN_CHARACTERS]
        raise Fault(f"flow control ({ascii(shown)[1:-1]}) is not supported: {PLAIN_MOVES}")


def _read_bare_or_text(block: Block, text: str, position: int) -> int:
    """Read a letter without a value, or quoted text; return the position after it."""
    # Marlin: an I without a value after M3, M4 or M5 selects inline laser power, as in `M3 S20 I`.
    if (
        text[position] == "I"
        and not LASER_CODES.isdisjoint(block.m)
        and BARE_LETTER.match(text, position)
    ):
        _add_word(block, "I", math.nan)
        return position + 1
    strange = any(x not in UNDERSTOOD_M for x in block.m)
    if strange and (match := QUOTED_TEXT.match(text, position)) is not None:
        return match.end()
    bare = strange or not BARE_WORDS.isdisjoint(block.g)
    if bare and BARE_LETTER.match(text, position):
        _add_word(block, text[position], math.nan)
        return position + 1
    raise Fault(_explain_syntax_error(text, position))


def _add(block: Block, letter: str, number: str, position: int) -> None:
    if len(number) > MAX_NUMBER_LENGTH:
        raise Fault(
            f"the number after {letter} must have at most {MAX_NUMBER_LENGTH} characters, but has "
            f"{len(number)}: round the number"
        )
    if letter == "N":
        if position or number[0] in "+-":
            raise Fault("a line number N must be unsigned and must be the first word of the line")
        return
    text, value = letter + number, float(number)
    if abs(value) > MAX_VALUE:
        raise Fault(f"the value of {text} is beyond the largest valid value, {MAX_VALUE:g}")
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
        raise Fault(f"the word {letter} occurs twice: remove one of the two words")
    block.words[letter] = value


def _add_g(block: Block, value: float, text: str) -> None:
    codes, code = block.g, round(value * 10)
    if code < 0 or abs(value * 10 - code) > WHOLE_TOLERANCE:
        raise Fault(f"{text} is not a valid G code")
    group = G_GROUP.get(code)
    for other in codes:
        if other == code or (group is not None and G_GROUP.get(other) == group):
            # G80 together with G0 or G1 is valid: programs begin with lines such as
            # G0 G17 G40 G49 G80 G90.
            if group == MOTION and 800 in (other, code) and min(other, code) <= 10:
                codes.remove(other)
                code = min(other, code)
                break
            _raise_conflict(g_name(other), g_name(code), group)
    codes.append(code)
    if group == MOTION:
        block.motion = code


def _add_m(codes: list[float], value: float, text: str) -> None:
    code = round(value) if abs(value - round(value)) <= WHOLE_TOLERANCE else value
    if code < 0 or (code != round(code) and code < FIRST_WITH_DECIMALS):
        raise Fault(f"{text} is not a valid M code")
    group = M_GROUP.get(code)
    for other in codes:
        if other == code or (group is not None and M_GROUP.get(other) == group):
            _raise_conflict(f"M{other:g}", f"M{code:g}", group)
    codes.append(code)


def _raise_conflict(first: str, second: str, group: str | None) -> None:
    group_name = f" from the group for {group}" if group else ""
    raise Fault(
        f"a line may have only one code{group_name}, but has {first} and {second}: write two lines"
    )


def whole_number(value: float, word: str) -> int:
    """Convert the value of a word that must be a whole number; `word` is for the message."""
    if not math.isfinite(value) or abs(value - round(value)) > WHOLE_TOLERANCE:
        raise Fault(f"{word} must be a whole number, but is {value:g}")
    return round(value)


def _explain_syntax_error(text: str, position: int) -> str:
    """Explain why no word or comment can be read at a position."""
    character = text[position]
    shown = ascii(text[position : position + SHOWN_CHARACTERS])
    if FANUC_FLOW.match(text, position) is not None:
        return f"flow control ({shown}) is not supported: {PLAIN_MOVES}"
    if (match := COMPUTED.match(text, position)) is not None:
        kind = "a parameter #" if match[0].endswith("#") else "an expression [ ]"
        return f"{kind} ({shown}) is not supported: {PLAIN_MOVES}"
    if character == "(":
        inner = text.find("(", position + 1)
        close = text.find(")", position + 1)
        if close < 0 or inner < 0:
            return "a comment begins with ( but does not end: close it with )"
        return "parentheses are not allowed within a comment ( ): remove the inner parentheses"
    if text.startswith(("//", "/*"), position):
        return (
            f"{text[position : position + 2]} does not start a comment in G-code: write comments "
            "in ( ) or after ;"
        )
    if FOREIGN.match(text, position) is not None:
        return (
            f"{shown} is a word of another dialect, such as Sinumerik: post-process the program "
            "in the CAM system for LinuxCNC or Fanuc"
        )
    if character.isascii() and character.isalpha():
        return f"the letter {character} is not followed by a number"
    if character in "@^":
        return "polar coordinates (@ or ^) are not supported: write X and Y"
    if character == "$":
        return (
            "$ is a command of a sender or controller, and is not valid in G-code: remove the line"
        )
    if text.startswith(("->", "<-", "<~")):
        return (
            "the file is the log of a sender (->, <-), not a program: specify the file of the "
            "program"
        )
    return f"{ascii(character)} does not start a word or a comment"


@dataclass(frozen=True, slots=True)
class Dialect:
    """Properties of a whole program that change the meaning of its words."""

    changes_tools: bool  # Whether the program has M6; otherwise T alone changes the tool
    extrudes: bool  # Whether a move of the program feeds material
    printer: bool  # Whether the program is for a 3D printer: G4 P is in milliseconds


def detect_dialect(lines: list[str]) -> Dialect:
    """Determine the dialect of a program from its lines."""
    extrudes = _any_matches(EXTRUSION, (x for x in lines if "E" in x or "e" in x))
    return Dialect(
        changes_tools=_any_matches(TOOL_CHANGE, (x for x in lines if "6" in x)),
        extrudes=extrudes,
        printer=extrudes or _any_matches(PRINTER_CODE, (x for x in lines if "M" in x or "m" in x)),
    )


def _any_matches(pattern: re.Pattern[str], lines: Iterable[str]) -> bool:
    """True if a pattern occurs in one of the lines outside of comments."""
    return any(
        pattern.search(COMMENTS.sub("", x)) is not None for x in lines if len(x) <= MAX_LINE_LENGTH
    )
