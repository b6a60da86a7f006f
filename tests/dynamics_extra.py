"""Skip tests that need the extra `dynamics`: pinocchio, and coal for clearance."""

from collections.abc import Collection, Iterable
from importlib.util import find_spec

import numpy as np
import pytest

REASON = "needs pip install 'armcontour[dynamics]'"

needs_dynamics = pytest.mark.skipif(find_spec("coal") is None, reason=REASON)


def pinocchio():
    """The module pinocchio; skips the calling test or file without it."""
    return pytest.importorskip("pinocchio", reason=REASON)


def pinocchio_model(chain):
    """Pinocchio's model of a chain with the frame `tool`, without friction and armature."""
    pin = pinocchio()
    model = pin.Model()
    joint = 0
    model.gravity.linear = np.array(chain.gravity)
    for k in range(len(chain)):
        place = pin.SE3(np.array(chain.rotations[k]), np.array(chain.positions[k]))
        prismatic = pin.JointModelPrismaticUnaligned
        revolute = pin.JointModelRevoluteUnaligned
        kind = (prismatic if chain.prismatic[k] else revolute)(np.array(chain.axes[k]))
        joint = model.addJoint(joint, kind, place, f"joint {k}")
        if chain.masses is not None:
            values = float(chain.masses[k]), np.array(chain.centers[k]), np.array(chain.inertias[k])
            model.appendBodyToJoint(joint, pin.Inertia(*values), pin.SE3.Identity())
    if chain.payload is not None:
        load = chain.payload
        carried = pin.Inertia(load.mass, np.array(load.center), np.array(load.inertia))
        tip = pin.SE3(np.array(chain.tip.rotation), np.array(chain.tip.position))
        model.appendBodyToJoint(joint, carried, tip)
    end = chain.tip @ chain.tool
    place = pin.SE3(np.array(end.rotation), np.array(end.position))
    model.addFrame(pin.Frame("tool", joint, place, pin.FrameType.OP_FRAME))
    return model


def mark_all_but(names: Iterable[str], others: Collection[str]):
    """Parameters of a test, of which all but some need the extra."""
    return [x if x in others else pytest.param(x, marks=needs_dynamics) for x in names]
