"""Values of a process."""

from tests.geometry.tables import refused

import armcontour as ac
from armcontour.program import Process

LINE = ac.Path.polyline([(0.3, 0.1), (0.4, 0.1)])
LASER = ac.Switch(name="laser")


def test_a_pierce_needs_a_switch_and_an_active_lead():
    pierce, idle = ac.Pierce(time=0.3), ac.Lead(length=5e-3)
    high = Process(pierce=ac.Pierce(time=0.1, height=1e-3), switch=LASER)
    refused(
        # Letters of a text would be names of outputs that do not exist, and the laser on in rapids.
        (lambda: Process(off_between="spindle"), "off_between", "list of names", "'spindle'"),
        (lambda: Process(switch="laser"), "switch of a process needs a Switch, not str."),
        (lambda: Process(pierce=pierce), "switch"),
        (lambda: Process(pierce=pierce, switch=LASER, lead_in=idle), "active"),
        (lambda: ac.Pierce(time=0.0), "time of a pierce"),
        (lambda: ac.Pierce(time=0.1, height=-1e-3), "height of a pierce"),
        (lambda: ac.prepare(LINE, high), "plane"),
    )
    marked = Process(pierce=pierce, switch=LASER, by_layer={"MARK": {"pierce": None}})
    assert marked.of_layer("CUT").begins_on and not marked.of_layer("MARK").begins_on
