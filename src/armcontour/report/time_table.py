"""How long each limit is active, for the report and the Studio."""

from __future__ import annotations

from dataclasses import replace

from armcontour.core.result import Table
from armcontour.planning import Explanation

# A limit that is active for a smaller fraction of the duration is not listed.
MIN_TIME_SHARE = 5e-5


def time_table(explanation: Explanation) -> Table:
    """Return how long limits are active, if it is at least `MIN_TIME_SHARE` of the time."""
    table = explanation.time_table
    of_time = [x.name for x in table.columns].index("of_time")
    return replace(table, rows=[x for x in table.rows if x[of_time] >= MIN_TIME_SHARE])
