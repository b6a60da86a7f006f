"""Tables of G and M codes: their numbers, their modal groups, and which ones the reader executes.

A G code is stored as ten times its number, so G61.1 is 611. Source of the groups: LinuxCNC manual,
"G-code Overview", section "Modal Groups".
"""

from __future__ import annotations

RAPID, LINE, CLOCKWISE, COUNTER_CLOCKWISE, DWELL = 0, 10, 20, 30, 40
ARCS = (CLOCKWISE, COUNTER_CLOCKWISE)
XY, ZX, YZ = 170, 180, 190
INCH, MILLIMETRE = 200, 210
CANCEL_MOTION = 800
ABSOLUTE, RELATIVE, ARC_ABSOLUTE, ARC_RELATIVE = 900, 910, 901, 911
INVERSE_TIME, PER_MINUTE, PER_TURN = 930, 940, 950
SURFACE_SPEED = 960
EXACT_PATH, EXACT_STOP, BLEND = 610, 611, 640

_MEMBERS: dict[str, tuple[int, ...]] = {
    "what is done once": (DWELL, 100, 280, 281, 300, 301, 520, 530, 920, 921, 922, 923),
    "motion": (
        *(RAPID, LINE, CLOCKWISE, COUNTER_CLOCKWISE, 50, 51, 52, 53, 330, 331),
        *(382, 383, 384, 385, 730, 740, 760, CANCEL_MOTION),
        *(810, 820, 830, 840, 850, 860, 870, 880, 890),
    ),
    "planes": (XY, ZX, YZ, 171, 181, 191),
    "distance mode": (ABSOLUTE, RELATIVE),
    "distance mode of arcs": (ARC_ABSOLUTE, ARC_RELATIVE),
    "feed mode": (INVERSE_TIME, PER_MINUTE, PER_TURN),
    "units": (INCH, MILLIMETRE),
    "cutter compensation": (400, 410, 411, 420, 421),
    "tool length": (430, 431, 432, 490),
    "return level": (980, 990),
    "coordinate systems": (540, 550, 560, 570, 580, 590, 591, 592, 593),
    "path control": (EXACT_PATH, EXACT_STOP, BLEND),
    "spindle mode": (SURFACE_SPEED, 970),
    "lathe mode": (70, 80),
}
G_GROUP = {code: group for group, members in _MEMBERS.items() for code in members}
M_GROUP = {
    **dict.fromkeys((0, 1, 2, 30, 60), "stopping"),
    **dict.fromkeys((3, 4, 5), "spindle"),
    **dict.fromkeys((7, 8, 9), "coolant"),
    **dict.fromkeys((48, 49), "overrides"),
}

# Codes that the reader executes, and codes that set the only state that the reader has: no
# compensation (G40, G49), the first coordinate system (G54), which is that of the drawing, feed
# per minute (G94), spindle speed in turns per minute (G97), X as a radius (G8), and the return
# level of canned cycles (G98, G99), which are refused.
UNDERSTOOD_G = frozenset(
    (
        *(RAPID, LINE, CLOCKWISE, COUNTER_CLOCKWISE, DWELL, CANCEL_MOTION, XY, ZX, YZ),
        *(INCH, MILLIMETRE, ABSOLUTE, RELATIVE, ARC_ABSOLUTE, ARC_RELATIVE, PER_MINUTE),
        *(EXACT_PATH, EXACT_STOP, BLEND, 80, 400, 490, 540, 970, 980, 990),
    )
)
UNDERSTOOD_M = frozenset((0, 1, 2, 3, 4, 5, 7, 8, 9, 30))

# Motions, calls of subprograms, and scales: without them the rest of the program would be at other
# positions. This includes codes of other dialects: polar coordinates, scaling, rotation, and units
# (G70, G71).
NEVER_SKIPPED_G = frozenset(
    (
        *(120, 130, 160, 500, 510, 511, 680, 700, 710, 720),
        *(50, 51, 52, 53, 70, 171, 181, 191, 330, 331, 382, 383, 384, 385, 730, 740, 760),
        *(810, 820, 830, 840, 850, 860, 870, 880, 890),
    )
)
NEVER_SKIPPED_M = frozenset((97, 98, 99))

# Codes that use all words of their line except F and S; if such a code is skipped, the motion of
# its line is skipped too.
OWN_THE_LINE = frozenset((100, 280, 281, 300, 301, 431, 432, 520, 530, 920))
# The other codes of the manual, which do not use the words X, Y and Z.
NO_USE_FOR_AXES = frozenset(G_GROUP) - NEVER_SKIPPED_G - OWN_THE_LINE
# Codes that do not use the words I, J, K, P, Q and R either.
TAKE_NO_WORDS_G = frozenset(
    code
    for code in NO_USE_FOR_AXES
    if G_GROUP[code] in ("coordinate systems", "cutter compensation", "tool length")
)
TAKE_NO_WORDS_M = frozenset((6, 48, 49, 60))


def g_name(code: int) -> str:
    """The G code as it is written in a program, such as G61.1 for 611."""
    return f"G{code // 10}" + (f".{code % 10}" if code % 10 else "")
