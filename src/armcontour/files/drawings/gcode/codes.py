"""What there is to know of a code before it is carried out: its group, and who understands it.

G codes are counted in tenths, so that G61.1 is 611. Source of the groups: LinuxCNC manual, "G-code
Overview", section "Modal Groups".
"""

from __future__ import annotations

# How a program in a programming language becomes one that is read.
PLAIN_MOVES = "let the CAM system post-process it to plain moves (G0 to G3)"

RAPID, LINE, CLOCKWISE, COUNTER_CLOCKWISE, DWELL = 0, 10, 20, 30, 40
ARCS = (CLOCKWISE, COUNTER_CLOCKWISE)
XY, ZX, YZ = 170, 180, 190
# First and second axis of every plane, as seen from the positive end of the third.
PLANES = {XY: (0, 1, 2), ZX: (2, 0, 1), YZ: (1, 2, 0)}
# Letters of coordinates, and of centres of arcs.
AXES, OFFSETS = "XYZ", "IJK"
INCH, MILLIMETRE = 200, 210
CANCEL_MOTION = 800
# Drilling: at once, with a dwell, and in pecks.
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
# G92.1, G92.2: the shift of G92 taken back.
NO_SHIFT = frozenset((921, 922))
RETURN_TO_START, RETURN_TO_R = 980, 990
# Cutter radius compensation; the second and the fourth have the tool's diameter itself as D.
NO_COMPENSATION, COMPENSATION = 400, (410, 411, 420, 421)
ON_THE_RIGHT, BY_DIAMETER = (420, 421), (411, 421)
MOTION = "motion"

_MEMBERS: dict[str, tuple[int, ...]] = {
    "what is done once": (DWELL, 100, 280, 281, 300, 301, 520, 530, 920, 921, 922, 923),
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

# Codes that are carried out, or that ask for what is so anyway: feed and speed in the usual units
# (G94, G97), radius (G8), no scale, rotation or polar coordinates (G15, G69), nothing called at
# every move (G67).
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

# Codes that move nothing without coordinates, and are left out with a note: smoothing (G5, G5.1 and
# G187 of other controllers), retraction of filament (G11), levelling of a printer's bed (G29),
# largest spindle speed (G50), constant surface speed (G96). Their P, Q, S, D and so on are theirs.
HARMLESS_G = frozenset((50, 51, 110, 290, 500, 960, 1870))
# Their letters may stand without a value: G28 X Y, G29 G.
BARE_WORDS = REFERENCE_MOVES | HARMLESS_G
# Why what shifts or turns the rest of the program is not read.
REFUSED_G = {
    70: "diameter mode, in which X is twice the radius: let the post-processor write radii (G8)",
    **dict.fromkeys((120, 130), "a circular pocket or polar coordinates: write G1, G2 and G3"),
    **dict.fromkeys((121, 131, 160, 1120), "polar coordinates: write X and Y"),
    **dict.fromkeys(
        (310, 382, 383, 384, 385),
        "a probe, whose result only the machine knows: give the program with the heights that "
        "were measured, as lines and arcs",
    ),
    **dict.fromkeys(
        (330, 331, 760, 842),
        "a thread, for which the spindle has to turn with the motion: a robot cannot cut it",
    ),
    **dict.fromkeys(
        (52, 53, 62, 63), "a spline of LinuxCNC: let the post-processor write lines and arcs"
    ),
    **dict.fromkeys(
        (700, 701, 702, 710, 711, 712, 720, 721, 722),
        "a lathe cycle, or a unit of another dialect (G70, G71): write G0 to G3, or G20 and G21",
    ),
    **dict.fromkeys((501, 510, 511), "scaled or mirrored coordinates: write the moves out"),
    **dict.fromkeys((680, 681, 682), "turned coordinates: write the moves out"),
    541: "a coordinate system whose offset is in the table of the controller and not in the file",
    950: "a feed per turn of the spindle: write G94, with F per minute",
    440: "tool length compensation in the opposite direction: use G43",
    **dict.fromkeys(
        (281, 301, 520, 923), f"a stored position or offset, which is not read; {PLAIN_MOVES}"
    ),
    **dict.fromkeys((650, 660), f"a call of a macro, which is not read; {PLAIN_MOVES}"),
    **dict.fromkeys(
        (730, 740, 840, 850, 860, 870, 880, 890),
        f"a canned cycle, of which only G81, G82 and G83 are read; {PLAIN_MOVES}",
    ),
}

# Motions of other kinds and other dialects: without them the rest of the program would be drawn
# somewhere else. Among them units (G70, G71) and planes of other axes.
NEVER_SKIPPED_G = frozenset(
    (
        *(120, 130, 160, 510, 511, 650, 660, 680, 700, 710, 720, 842, 171, 181, 191),
        *(62, 63, 70, 950),
    )
)
# Calls and returns of subprograms.
CALLS = frozenset((97, 98, 99))
# Brings back modes that M70 saved; with words of its own it is a printer's.
RESTORE = 72
# To these belong all words of their line but F and S: where they are skipped, so is its motion.
OWN_THE_LINE = frozenset((SET_DATA, *REFERENCE_MOVES, 431, 432, MACHINE, SHIFT))


def g_name(code: int) -> str:
    """How a G code is written."""
    return f"G{code // 10}" + (f".{code % 10}" if code % 10 else "")
