"""Serve roboplan's Cartesian planner in its own Python: it plans and times itself on request.

A request is one line of JSON on the standard input, and so is its answer on the standard output.
"""

import json
import sys
import time

import numpy as np
from roboplan.cartesian_planning import (
    CartesianPathPlanner,
    CartesianPlannerOptions,
    CartesianSpeedMode,
)
from roboplan.core import (
    CartesianPath,
    JointConfiguration,
    Scene,
    loadJointLimitsConfig,
    loadUrdfSceneDescription,
)


class Peer:
    """One arm, one start, and planners by name."""

    def __init__(self, urdf, limits, base, tool, start):
        self.scene = Scene("benchmark", loadUrdfSceneDescription(urdf, []))
        self.scene.importJointLimitsFromConfig(loadJointLimitsConfig(limits))
        self.scene.addGroupFromChain("arm", base, tool)
        self.base = base
        self.tool = tool
        self.start = JointConfiguration()
        self.start.positions = np.array(start)
        self.prepared = {}
        self.planned = {}

    def prepare(self, name, poses, mode, options):
        """Make a planner for poses (n, 4, 4), and plan once, without timing."""
        frames = [np.asfortranarray(x, dtype=float) for x in poses]
        options = CartesianPlannerOptions(
            group_name="arm", speed_mode=getattr(CartesianSpeedMode, mode), **options
        )
        path = CartesianPath([self.base], [self.tool], [frames])
        self.prepared[name] = CartesianPathPlanner(self.scene, options), path
        return self.time(name, 0)

    def time(self, name, runs):
        """Return the processor time of plans [s], after one that is not timed."""
        planner, path = self.prepared[name]
        taken = []
        for _ in range(runs + 1):
            begin = time.process_time()
            self.planned[name] = planner.plan(path, self.start)
            taken.append(time.process_time() - begin)
        return taken[1:]

    def answer(self, name):
        """Return the last plan: times, positions, velocities, accelerations."""
        trajectory = self.planned[name]
        values = (
            trajectory.times,
            trajectory.positions,
            trajectory.velocities,
            trajectory.accelerations,
        )
        return [np.asarray(x).tolist() for x in values]


def main():
    """Execute requests until the input ends."""
    peer = None
    for line in sys.stdin:
        method, arguments = json.loads(line)
        try:
            if method == "arm":
                peer = Peer(**arguments)
                answer = None
            else:
                answer = getattr(peer, method)(**arguments)
            print(json.dumps([answer, None]), flush=True)
        except Exception as error:
            print(json.dumps([None, str(error)]), flush=True)


main()
