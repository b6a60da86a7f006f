"""Blocks of joint states, with which compiled code uses vector instructions.

A row holds one number of all states of a block.
"""

from __future__ import annotations

import math

from armcontour._checks import FloatArray
from armcontour._kernels import FUSED, compiled

# States of a block.
B = 32
# Half a turn in two parts of 33 bits: the multiples below the angle EXACT_TO [rad] are exact.
HALF_TURN, REST_OF_IT = 3.1415926534682512, 1.2154201012607932e-10
EXACT_TO = 1e6
# Added to a number and subtracted again, this rounds it to a whole number.
TO_WHOLE = 6755399441055744.0
# The Taylor series of sine over x and of cosine, in x², from their last terms that count for
# angles up to a quarter turn.
SINE = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(10, -1, -1))
COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(11, -1, -1))


@compiled(inner=True, fastmath=FUSED)
def write_sines(own: FloatArray) -> None:
    """Write the cosines and sines of the joint positions [rad] in row 0 into rows 0 and 1."""
    largest = 0.0
    for i in range(B):
        largest = max(largest, abs(own[i]))
    if not largest < EXACT_TO:
        for i in range(B):
            own[B + i], own[i] = math.sin(own[i]), math.cos(own[i])
        return
    for i in range(B):
        turns = (own[i] * (1 / math.pi) + TO_WHOLE) - TO_WHOLE
        odd = turns - 2.0 * ((turns * 0.5 + TO_WHOLE) - TO_WHOLE)
        x = (own[i] - turns * HALF_TURN) - turns * REST_OF_IT
        square, sine, cosine = x * x, 0.0, 0.0
        for term in SINE:
            sine = sine * square + term
        for term in COSINE:
            cosine = cosine * square + term
        sign = 1.0 - 2.0 * odd * odd
        own[i], own[B + i] = sign * cosine, sign * sine * x
