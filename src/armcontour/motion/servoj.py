"""Arguments of UR's command `servoj`, for exported programs and `play`."""

from __future__ import annotations

from typing import Annotated

from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import Quantity

Gain = Annotated[float, Quantity("", within=(100.0, 2000.0))]
Lookahead = Annotated[float, Quantity("s", "100 ms", within=(0.03, 0.2))]


@declared()
class Servoj(Checked):
    """Arguments of UR's `servoj`; use those with which the servo was identified.

    Ranges and defaults are from UR's script manual, `servoj`.

    >>> Servoj(lookahead=0.05).gain
    300.0

    Args:
        gain: Proportional gain of the controller, from 100 to 2000.
        lookahead: Time with which the controller smooths the motion [s], from 0.03 to 0.2 s.
    """

    gain: Gain = 300.0
    lookahead: Lookahead = 0.1
