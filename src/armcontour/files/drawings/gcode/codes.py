"""G and M codes: modal groups, and the codes that the reader executes, skips or refuses.

G codes are integers in tenths: G61.1 is 611. Source of the groups: LinuxCNC manual, "G-code
Overview", section "Modal Groups".
"""

from __future__ import annotations

# Advice in messages about flow control, macros and cycles.
PLAIN_MOVES = "post-process the program in the CAM system to plain moves (G0 to G3)"

RAPID, LINE, CLOCKWISE, COUNTER_CLOCKWISE, DWELL = 0, 10, 20, 30, 40
ARCS = (CLOCKWISE, COUNTER_CLOCKWISE)
XY, ZX, YZ = 170, 180, 190
# Indices of the first and second axis of each plane, and of the axis normal to the plane. Seen from
# the positive end of the normal, the second axis is 90° counter-clockwise from the first.
PLANES = {XY: (0, 1, 2), ZX: (2, 0, 1), YZ: (1, 2, 0)}
# Letters of coordinates, and of the offsets from the start of an arc to its centre.
AXES, OFFSETS = "XYZ", "IJK"
INCH, MILLIMETRE = 200, 210
CANCEL_MOTION = 800
# Drilling cycles: in one feed move, with a dwell at the bottom, and in pecks.
CYCLES = (810, 820, 830)
DRILL_AND_DWELL, PECK = 820, 830
ABSOLUTE, RELATIVE, ARC_ABSOLUTE, ARC_RELATIVE = 900, 910, 901, 911
INVERSE_TIME, PER_MINUTE = 930, 940
EXACT_PATH, EXACT_STOP, BLEND = 610, 611, 640
TOOL_LENGTH = (430, 431, 432, 490)
# The coordinate systems G54 to G59.3.
SYSTEMS = (540, 550, 560, 570, 580, 590, 591, 592, 593)
REFERENCE_MOVES = frozenset((280, 300))
SET_DATA, MACHINE, SHIFT = 100, 530, 920
# G92.1, G92.2: cancel the shift of G92.
NO_SHIFT = frozenset((921, 922))
RETURN_TO_START, RETURN_TO_R = 980, 990
# Cutter radius compensation off and on. In G41.1 and G42.1 the word D is the diameter of the tool.
NO_COMPENSATION, COMPENSATION = 400, (410, 411, 420, 421)
ON_THE_RIGHT, BY_DIAMETER = (420, 421), (411, 421)
MOTION = "motion"

_MEMBERS: dict[str, tuple[int, ...]] = {
    "non-modal codes": (DWELL, 100, 280, 281, 300, 301, 520, 530, 920, 921, 922, 923),
    MOTION: (
        *(RAPID, LINE, CLOCKWISE, COUNTER_CLOCKWISE, 50, 51, 52, 53, 330, 331),
        *(382, 383, 384, 385, 730, 740, 760, CANCEL_MOTION),
        *(810, 820, 830, 840, 850, 860, 870, 880, 890),
    ),
    "planes": (XY, ZX, YZ, 171, 181, 191),
    "distance mode": (ABSOLUTE, RELATIVE),
    "distance mode of arcs": (ARC_ABSOLUTE, ARC_RELATIVE),
    "feed mode": (INVERSE_TIME, PER_MINUTE, 950),
    "units": (INCH, MILLIMETRE),
    "cutter compensation": (NO_COMPENSATION, *COMPENSATION),
    "tool length": TOOL_LENGTH,
    "return level": (980, 990),
    "coordinate systems": SYSTEMS,
    "path control": (EXACT_PATH, EXACT_STOP, BLEND),
    "spindle mode": (960, 970),
    "lathe mode": (70, 80),
}
G_GROUP = {code: group for group, members in _MEMBERS.items() for code in members}
M_GROUP: dict[float, str] = {
    **dict.fromkeys((0, 1, 2, 30, 60), "stopping"),
    **dict.fromkeys((3, 4, 5), "spindle"),
    **dict.fromkeys((7, 8, 9), "coolant"),
    **dict.fromkeys((48, 49), "overrides"),
}

# Codes that are executed, or that select the only supported mode: feed per minute and spindle speed
# (G94, G97), radius (G8), no scale, rotation or polar coordinates (G15, G69), no modal macro (G67).
UNDERSTOOD_G = frozenset(
    (
        *(RAPID, LINE, CLOCKWISE, COUNTER_CLOCKWISE, DWELL, CANCEL_MOTION, XY, ZX, YZ),
        *(INCH, MILLIMETRE, ABSOLUTE, RELATIVE, ARC_ABSOLUTE, ARC_RELATIVE),
        *(INVERSE_TIME, PER_MINUTE, EXACT_PATH, EXACT_STOP, BLEND),
        *(NO_COMPENSATION, *COMPENSATION, 80, 150, 670, 690, 970, RETURN_TO_START, RETURN_TO_R),
        *(*TOOL_LENGTH, *SYSTEMS, *CYCLES, *REFERENCE_MOVES),
        *(SET_DATA, MACHINE, SHIFT, *NO_SHIFT),
    )
)
UNDERSTOOD_M = frozenset((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 30, 60, 62, 63, 64, 65, 67, 68, 82, 83))

# Codes that cause no motion if they have no coordinates. They are skipped with their words and with
# a note: smoothing (G5, G5.1 and G187 of other controllers), end of filament retraction (G11),
# levelling of a printer's bed (G29), maximum spindle speed (G50), constant surface speed (G96).
HARMLESS_G = frozenset((50, 51, 110, 290, 500, 960, 1870))
# Codes after which letters may have no value: G28 X Y, G29 G.
BARE_WORDS = REFERENCE_MOVES | HARMLESS_G
# Meanings of codes that would change the rest of the program, and the advice to the user. The
# message is "G7 is not supported (meaning): advice".
REFUSED_G = {
    70: ("diameter mode, in which X is twice the radius", "post-process the program with radii"),
    **dict.fromkeys(
        (120, 130), ("a circular pocket or polar coordinates", "write G1, G2 and G3 instead")
    ),
    **dict.fromkeys((121, 131, 160, 1120), ("polar coordinates", "write X and Y instead")),
    **dict.fromkeys(
        (310, 382, 383, 384, 385),
        (
            "a probe, whose result is unknown to the reader",
            "write lines and arcs with the measured heights instead",
        ),
    ),
    **dict.fromkeys(
        (330, 331, 760, 842),
        (
            "a thread, which requires a spindle that is synchronized with the motion",
            "remove the thread from the program",
        ),
    ),
    **dict.fromkeys(
        (52, 53, 62, 63),
        ("a spline of LinuxCNC", "post-process the program to lines and arcs"),
    ),
    **dict.fromkeys(
        (700, 701, 702, 710, 711, 712, 720, 721, 722),
        (
            "a lathe cycle, or a unit of another dialect (G70, G71)",
            "write G0 to G3, or G20 and G21, instead",
        ),
    ),
    **dict.fromkeys(
        (501, 510, 511), ("scaled or mirrored coordinates", "write the resulting moves instead")
    ),
    **dict.fromkeys((680, 681, 682), ("rotated coordinates", "write the resulting moves instead")),
    541: (
        "a coordinate system whose offset is in the controller and not in the file",
        "post-process the program with one coordinate system",
    ),
    950: ("feed per spindle revolution", "write G94, with F per minute, instead"),
    440: ("tool length compensation in the opposite direction", "write G43 instead"),
    **dict.fromkeys((281, 301, 520, 923), ("a stored position or offset", PLAIN_MOVES)),
    **dict.fromkeys((650, 660), ("a macro call", PLAIN_MOVES)),
    **dict.fromkeys(
        (730, 740, 840, 850, 860, 870, 880, 890),
        ("a canned cycle other than G81, G82 and G83", PLAIN_MOVES),
    ),
}

# Motions and modes of other dialects, such as units (G70, G71) and planes of other axes. They are
# never skipped, because the rest of the program would be displaced without them.
NEVER_SKIPPED_G = frozenset(
    (
        *(120, 130, 160, 510, 511, 650, 660, 680, 700, 710, 720, 842, 171, 181, 191),
        *(62, 63, 70, 950),
    )
)
# M codes that call subprograms or return from them.
CALLS = frozenset((97, 98, 99))
# M72 restores the modes that M70 saved. With the words P, R or S it is a code of printers.
RESTORE = 72
# Codes that use all words of their line except F and S. If such a code is skipped, the motion of
# its line is also skipped.
OWN_THE_LINE = frozenset((SET_DATA, *REFERENCE_MOVES, 431, 432, MACHINE, SHIFT))


def g_name(code: int) -> str:
    """Name of a G code that is given in tenths: 611 is G61.1."""
    return f"G{code // 10}" + (f".{code % 10}" if code % 10 else "")
