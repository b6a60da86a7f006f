"""Parser for the words of G-code lines, with the errors and notes of the reader."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping

from armcontour.core.errors import InvalidInput
from armcontour.core.text import list_some, show
from armcontour.geometry.origins import line_origin
from armcontour.program.moves import Value

# Length units of a program [m]:
MILLIMETRE = 1e-3
INCH = 0.0254
LEFT_OUT_NOTE = "Ignored because it causes no motion: {}."
# Largest number of kinds that a note lists.
MAX_KINDS = 12
PLAIN_MOVES = "Post-process the program in the CAM system to plain moves (G0 to G3)"
# Maximum length of a number [characters]. Seventeen digits distinguish all doubles.
MAX_NUMBER_LENGTH = 34
# Largest absolute value of a word; coordinates have a separate limit in metres.
MAX_VALUE = 1e9
# Maximum length of a line [characters]; real programs need about ten, with comments some hundred.
MAX_LINE_LENGTH = 65_536
# Number of characters that a message shows of a rejected text.
SHOWN_CHARACTERS = 30
# A value counts as a whole number if it differs from the nearest whole number by at most this
# (LinuxCNC manual, "Numbers").
WHOLE_TOLERANCE = 1e-4
TOKEN = re.compile(
    r"([A-Z$])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))(?![0-9.=])|\([^()]*\)|;.*", re.DOTALL
)
EXPONENT = re.compile(r"[0-9.][eE]")
COMMENTS = re.compile(r"\([^()]*\)|;.*", re.DOTALL)
# Matches a line with an O word: a program number (group 2), or flow control.
O_WORD = re.compile(r"(?:N[0-9]+)?(O[0-9]+(?:\.0*)?($)|O.*)", re.DOTALL)
# Removes white space and converts to capitals, because white space and case are ignored (LinuxCNC
# manual, "Format of a line").
TO_COMPACT = str.maketrans(
    {c: None for c in " \t\r\n"} | {chr(i): chr(i - 32) for i in range(ord("a"), ord("z") + 1)}
)
TOOL_CHANGE = re.compile(r"M0*6(?![0-9.])")
# G codes are integers in tenths: G61.1 is 611.
RAPID = 0
LINE = 10
CLOCKWISE = 20  # Arc
COUNTER_CLOCKWISE = 30  # Arc
DWELL = 40
CANCEL_MOTION = 800
XY = 170  # Plane of arcs
ZX = 180  # Plane of arcs
YZ = 190  # Plane of arcs
INCHES = 200
MILLIMETRES = 210
REFERENCE = 280  # Move to the reference position
SECOND_REFERENCE = 300  # Move to the second reference position, such as that for tool changes
MACHINE = 530  # Move in machine coordinates
SHIFT = 920  # Set the current position, supported for the extruder only
TOOL_LENGTH = 430
SYSTEMS = (540, 550, 560, 570, 580, 590)
EXACT_PATH = 610
EXACT_STOP = 611
BLEND = 640
ABSOLUTE = 900  # Coordinates
RELATIVE = 910  # Coordinates
ARC_ABSOLUTE = 901  # Centres of arcs
ARC_RELATIVE = 911  # Centres of arcs
MOTION = "motion"
# The supported G codes by modal group (LinuxCNC manual, "G-code Overview", "Modal Groups"). Codes
# without an effect select the only supported mode: no compensation of the cutter radius (G40), feed
# per minute (G94), the return level of drilling cycles (G98, G99).
G_GROUP: dict[int, str] = {
    **dict.fromkeys((DWELL, REFERENCE, SECOND_REFERENCE, MACHINE, SHIFT), "non-modal codes"),
    **dict.fromkeys((RAPID, LINE, CLOCKWISE, COUNTER_CLOCKWISE, CANCEL_MOTION), MOTION),
    **dict.fromkeys((XY, ZX, YZ), "planes"),
    **dict.fromkeys((ABSOLUTE, RELATIVE), "distance mode"),
    **dict.fromkeys((ARC_ABSOLUTE, ARC_RELATIVE), "distance mode of arcs"),
    940: "feed mode",
    **dict.fromkeys((INCHES, MILLIMETRES), "units"),
    400: "cutter compensation",
    **dict.fromkeys((TOOL_LENGTH, 490), "tool length"),
    **dict.fromkeys((980, 990), "return level"),
    **dict.fromkeys(SYSTEMS, "coordinate systems"),
    **dict.fromkeys((EXACT_PATH, EXACT_STOP, BLEND), "path control"),
}
# Modal codes that cause no motion: diameters off (G8), polar interpolation off (G13.1), polar
# coordinates off (G15), limits of the work space off (G23), normal direction off (G40.1), modal
# macro off (G67), rotation off (G69), and the spindle speed in revolutions per minute (G97).
WITHOUT_MOTION = frozenset((80, 131, 150, 230, 401, 670, 690, 970))
# Modal codes that cause no motion if their line has no coordinates: the look-ahead of controllers
# of Fanuc (G5 P10000, G5.1 Q1) and Haas (G187 P1), and scaling off (G50). With coordinates, G5 and
# G5.1 are splines, and G50 shifts the origin of a lathe.
WITHOUT_COORDINATES = frozenset((50, 51, 500, 1870))
# Words of the codes in WITHOUT_COORDINATES.
SETTINGS = "PQRE"
COORDINATES = "XYZABCUVWIJK"
# What to do instead of a code that is not supported.
INSTEAD = {
    **dict.fromkeys(
        range(410, 430),
        "Let the CAM system compute the path of the tool's centre (compensation in computer)",
    ),
    **dict.fromkeys(
        (730, *range(810, 900, 10)),
        "Let the post-processor write drilling cycles as plain moves (G0 to G3)",
    ),
    960: "A constant surface speed is for lathes, whose programs do not suit a robot",
}
M_GROUP: dict[int, str] = {
    **dict.fromkeys((0, 1, 2, 30), "stopping"),
    **dict.fromkeys((3, 4, 5), "spindle"),
    **dict.fromkeys((7, 8, 9), "coolant"),
}
UNDERSTOOD_M = frozenset((*range(10), 30, 62, 63, 64, 65, 67, 68))
TOOL_CHANGE_CODE = 6
# M codes that call subprograms or return from them, or restore modes.
CALLS = frozenset((72, 97, 98, 99))
# Commands of Klipper that cause no motion, by their first words.
KLIPPER_SETTINGS = (
    "EXCLUDE_OBJECT",
    "SET_FAN_SPEED",
    "SET_HEATER_TEMPERATURE",
    "SET_PRESSURE_ADVANCE",
    "SET_PRINT_STATS_INFO",
    "SET_VELOCITY_LIMIT",
    "TIMELAPSE_TAKE_FRAME",
)
# Usual names of the macros with which slicers begin and end a program for Klipper.
KLIPPER_FRAME = ("START_PRINT", "PRINT_START", "END_PRINT", "PRINT_END")
# Matches a line that begins with a command of Klipper.
KLIPPER = re.compile(r"[ \t]*([A-Za-z]+(?:_[A-Za-z0-9]+)+)(?![A-Za-z0-9_])")
KLIPPER_NOTE = (
    "Ignored, because only the configuration of the printer defines them: {}. If they move the "
    "tool, write these moves to the file."
)
# Matches a line that begins with an M code. The text after an unknown M code belongs to this code,
# as in M117 Hello, M862.3 P "MK3S" and M84 X Y.
LEADING_M = re.compile(r"(?:N[0-9]+)?M([0-9]+(?:\.[0-9]*)?)")


# Controllers that comments name, by their meaning of the word P of an arc. LinuxCNC (manual,
# "G2, G3 Arc Move") and FluidNC count all turns, Marlin ("G2-G3") the full circles before the arc.
CONTROLLERS_OF_TURNS = {
    "total": re.compile(r"linuxcnc|fluidnc", re.IGNORECASE),
    "extra": re.compile(r"marlin", re.IGNORECASE),
}


# M codes that cannot be declared to switch outputs: stops, the tool change, the end of the program.
NOT_DECLARED = frozenset((0, 1, 2, TOOL_CHANGE_CODE, 30)) | CALLS
DECLARED = re.compile(r"([GM])([0-9]+(?:\.[0-9]+)?)")
# Words of declared codes, which are ignored if their line does not move the tool.
DECLARED_WORDS = "DEHLPQR"


class Fault(Exception):
    """An error in a line; the text is a sentence without a full stop, after the line number."""


class Notes:
    """Notes on skipped content and on the interpretation of lines, and the current line."""

    def __init__(self) -> None:
        self.line = 0
        # Number after the letter N of the current line; None without it.
        self.block_number: int | None = None
        # First line of each skipped kind, by template of the note and kind.
        self.first_line_of_kind: dict[str, dict[str, int]] = {LEFT_OUT_NOTE: {}}
        # First line to which a note of `add_once` applies, by template of the note.
        self.first_line_of_note: dict[str, int] = {}

    @property
    def origin(self) -> int:
        """Origin of the segments that the current line defines."""
        return line_origin(self.line, self.block_number)

    def skip(self, kind: str, sentence: str = LEFT_OUT_NOTE) -> None:
        """Note a skipped item; `{}` in the sentence is replaced by the list of all kinds."""
        self.first_line_of_kind.setdefault(sentence, {}).setdefault(kind, self.line)

    def add_once(self, sentence: str, line: int = 0) -> None:
        """Note how lines are interpreted; `{}` is replaced by the number of the first such line.

        `line`: the number of the line; 0 for the current line.
        """
        self.first_line_of_note.setdefault(sentence, line or self.line)

    def sentences(self) -> list[str]:
        """Return all notes as complete sentences."""
        skipped = []
        for sentence, lines in self.first_line_of_kind.items():
            if lines:
                listed = [f"{kind} (first in line {i})" for kind, i in lines.items()]
                skipped.append(sentence.format(list_some(listed, MAX_KINDS)))
        once = [sentence.format(line) for sentence, line in self.first_line_of_note.items()]
        return skipped + once


def named_arc_turns(lines: Iterable[str]) -> str | None:
    """Return the meaning of P of arcs for the controller that comments name; None if unknown.

    - `lines`: all lines of the program.
    """
    comments = [x for line in lines if "(" in line or ";" in line for x in COMMENTS.findall(line)]
    named = [
        meaning
        for meaning, controllers in CONTROLLERS_OF_TURNS.items()
        if any(controllers.search(x) for x in comments)
    ]
    return named[0] if len(named) == 1 else None


class Block:
    """The words of a line: G codes in tenths, M codes, and the other words by letter.

    `motion` is the G code of the modal group for motion, or None; `declared` has the names of codes
    that the options declare.
    """

    __slots__ = ("declared", "g", "m", "motion", "settings", "words")

    def __init__(self) -> None:
        self.g: list[int] = []
        self.motion: int | None = None
        self.m: list[int] = []
        self.declared: list[str] = []
        self.words: dict[str, float] = {}
        # The codes in WITHOUT_COORDINATES.
        self.settings: list[int] = []

    def drop(self, letters: str) -> None:
        """Remove the words with these letters, if the line has them."""
        for letter in letters:
            self.words.pop(letter, None)


def read_declared(words: Mapping[str, Mapping[str, Value]]) -> dict[str, Mapping[str, Value]]:
    """Return the states that declared codes set, by the name of the code: M101, G83.

    Raises:
        InvalidInput: A code is not an M or G code, or has a meaning that must not change: motions
            and modes of G, stops and calls of subprograms.
    """
    found = {}
    for word, states in words.items():
        match = DECLARED.fullmatch(word.upper())
        code = -1.0 if match is None else float(match[2])
        is_known = match is not None and match[1] == "G" and round(code * 10) in G_GROUP
        if match is None or is_known or (match[1] == "M" and code in NOT_DECLARED):
            raise InvalidInput(
                "words must be M or G codes that switch outputs, such as M101 or G83, not "
                f"{show(word)}. Motions, modes, stops and subprograms keep their meaning.",
                key=("words", word),
            )
        found[f"{match[1]}{code:g}"] = states
    return found


def parse(line: str, notes: Notes, declared: Collection[str] = ()) -> Block:
    """Parse a line into its words. The block is empty for a comment or a program number.

    - `declared`: names of codes that the options declare, which get no other meaning.
    """
    text = line.translate(TO_COMPACT)
    block = Block()
    if "_" in text and (match := KLIPPER.match(line)) is not None:
        _skip_klipper(match[1].upper(), notes)
        return block
    if "O" in text and (match := O_WORD.match(COMMENTS.sub("", text))) is not None:
        if match[2] is None:
            raise unsupported(ascii(match[1][:SHOWN_CHARACTERS]))
        return block
    match = LEADING_M.match(text)
    if match and f"M{float(match[1]):g}" not in declared and _is_left_out(float(match[1])):
        notes.skip(f"M{float(match[1]):g}")
        return block
    position = 0
    while position < len(text):
        match = TOKEN.match(text, position)
        if match is None:
            raise Fault(_explain_syntax_error(text, position))
        if match[1] is not None:
            name = f"{match[1]}{float(match[2]):g}" if match[1] in "GM" else ""
            if declared and name in declared:
                block.declared.append(name)
            else:
                _add_word(block, match[1], match[2], position, notes)
        position = match.end()
    if "E" in block.words and EXPONENT.search(COMMENTS.sub(" ", line)):
        raise Fault(
            "numbers with an exponent are not valid in G-code. Write the number without an "
            "exponent, or write a space before E if E is a word"
        )
    if block.settings:
        _drop_settings(block, notes)
    return block


def _skip_klipper(command: str, notes: Notes) -> None:
    """Note a command of Klipper that is left out; refuse commands that can move the tool."""
    if command.startswith(KLIPPER_SETTINGS):
        notes.skip(command)
    elif command in KLIPPER_FRAME:
        notes.skip(command, KLIPPER_NOTE)
    else:
        raise Fault(
            f"{command[:SHOWN_CHARACTERS]} is a command or a macro of Klipper, which only the "
            "configuration of the printer defines. Remove the line, or write its moves as G0 and "
            "G1"
        )


def _drop_settings(block: Block, notes: Notes) -> None:
    """Leave out the settings of a controller with their words, and note them."""
    for code in block.settings:
        if any(letter in block.words for letter in COORDINATES):
            raise unsupported(g_name(code))
        notes.skip(g_name(code))
    block.drop(SETTINGS)


def _add_word(block: Block, letter: str, number: str, position: int, notes: Notes) -> None:
    """Add a word to a block, or note that it is skipped.

    - `number`: text of the word after its letter.
    - `position`: index of the word in the text of the line.
    """
    if len(number) > MAX_NUMBER_LENGTH:
        raise Fault(
            f"the number after {letter} must have at most {MAX_NUMBER_LENGTH} characters, but has "
            f"{len(number)}. Round the number"
        )
    if letter == "N":
        if position or number[0] in "+-":
            raise Fault("a line number N must be unsigned and must be the first word of the line")
        if number.isdigit():
            notes.block_number = int(number)
        return
    text = letter + number
    value = float(number)
    if abs(value) > MAX_VALUE:
        raise Fault(f"the value of {text} is beyond the largest valid value, {MAX_VALUE:g}")
    if letter == "G":
        _add_g(block, value, text, notes)
    elif letter == "M":
        if value < 0:
            raise unsupported(text)
        if _is_left_out(value):
            notes.skip(f"M{value:g}")
            return
        _add_code(block.m, round(value), M_GROUP, "M{:d}".format)
    elif letter in block.words:
        raise Fault(f"the word {letter} occurs twice. Remove one of the two words")
    else:
        block.words[letter] = value


def _is_left_out(code: float) -> bool:
    """Return whether an M code is skipped, because it is unknown; refuse calls of subprograms."""
    if code in CALLS:
        raise unsupported(f"M{code:g}")
    return code not in UNDERSTOOD_M


def _add_g(block: Block, value: float, text: str, notes: Notes) -> None:
    """Add a G code to a block, or note that it is skipped; `text`: the word, for messages."""
    code = round(value * 10)
    if code in WITHOUT_MOTION and abs(value * 10 - code) <= WHOLE_TOLERANCE:
        notes.skip(g_name(code))
        return
    if code in WITHOUT_COORDINATES and abs(value * 10 - code) <= WHOLE_TOLERANCE:
        block.settings.append(code)
        return
    if abs(value * 10 - code) > WHOLE_TOLERANCE or code not in G_GROUP:
        remedy = INSTEAD.get(code, PLAIN_MOVES)
        raise unsupported(text, f"{remedy}. If it only switches outputs, declare it in path.words")
    if G_GROUP[code] == MOTION:
        # G80 together with G0 or G1 is valid: programs begin with lines such as
        # G0 G17 G40 G49 G80 G90.
        if block.motion is not None and {block.motion, code} in ({800, 0}, {800, 10}):
            block.g.remove(block.motion)
            code = min(block.motion, code)
        block.motion = code
    _add_code(block.g, code, G_GROUP, g_name)


def _add_code(
    codes: list[int], code: int, groups: Mapping[int, str], name: Callable[[int], str]
) -> None:
    """Add a code to those of the line, which may have only one of each group."""
    group = groups.get(code)
    for other in codes:
        if other == code or (group is not None and groups.get(other) == group):
            group_name = f" from the group for {group}" if group else ""
            raise Fault(
                f"a line may have only one code{group_name}, but has {name(other)} and "
                f"{name(code)}. Write two lines"
            )
    codes.append(code)


def g_name(code: int) -> str:
    """Return the name of a G code that is given in tenths: 611 is G61.1."""
    return f"G{code // 10}" + (f".{code % 10}" if code % 10 else "")


def unsupported(text: str, remedy: str = PLAIN_MOVES) -> Fault:
    """Return the error for a word or text that is not supported; `remedy`: what to do instead."""
    return Fault(f"{text} is not supported. {remedy}")


def whole_number(value: float, word: str) -> int:
    """Convert the value of a word that must be a whole number; `word` is for the message."""
    if abs(value - round(value)) > WHOLE_TOLERANCE:
        raise Fault(f"{word} must be a whole number, but is {value:g}")
    return round(value)


def _explain_syntax_error(text: str, position: int) -> str:
    """Explain why no word or comment can be read at a position."""
    if text[position] == "(":
        close = text.find(")", position)
        inner = text.find("(", position + 1)
        if close < 0 or inner < 0:
            return "a comment begins with ( but does not end. Close it with )"
        return "parentheses are not allowed within a comment ( ). Remove the inner parentheses"
    return str(unsupported(ascii(text[position : position + SHOWN_CHARACTERS])))


def changes_tools(lines: list[str]) -> bool:
    """Return whether a program changes tools with M6; otherwise T alone changes the tool."""
    return any(
        TOOL_CHANGE.search(COMMENTS.sub("", x.translate(TO_COMPACT)))
        for x in lines
        if "6" in x and len(x) <= MAX_LINE_LENGTH
    )
