"""Set-points that leave the path are not written for controllers that plan the motion."""

import pytest

import armcontour as ac
from armcontour.files.exports import TemplateFormat
from armcontour.files.exports.formats import FORMATS, format_named
from armcontour.files.exports.template import BUILT_IN

ARM = ac.load_arm("ur5e")
PATH = ac.Path.polyline([(0.4, -0.05, 0.2), (0.5, -0.05, 0.2), (0.5, 0.05, 0.2)])
ROUNDED = ac.round_corners(PATH.pointing((0, 0, -1)), tolerance=1e-3)
PLAN = ac.plan(ROUNDED, ARM, ARM.limits.replace(speed=0.2))
SERVO = ac.ServoModel(kp=25.0, kv=150.0)


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_program_without_times_has_the_plan_only(name, tmp_path):
    form = TemplateFormat(template=name)
    compensated = ac.compensate(PLAN, SERVO)
    for data in (PLAN, ac.compensate(PLAN, SERVO, ac.NoCompensation())):
        ac.export(data, tmp_path / f"plan.{name}", form)
    with pytest.raises(ac.InvalidInput, match="plans the motion between them"):
        ac.export(compensated, tmp_path / f"part.{name}", form)
    assert not (tmp_path / f"part.{name}").exists()


def test_every_format_states_who_times_the_motion():
    """A format of programs cannot forget it, because the field has no default."""
    kept = {x for x in (*FORMATS, *BUILT_IN) if format_named(x).keeps_times}
    assert kept == set(FORMATS)
