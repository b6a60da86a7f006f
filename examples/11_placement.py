"""Position of the part with the shortest cycle: `place` finds the best position of a grid of 24."""

import numpy as np

import armcontour as ac

arm = ac.load_arm("ur5e")
square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]])
path = ac.Path.polyline((0.40, -0.05, 0.20) + 0.1 * square).pointing((0.0, 0.0, -1.0))
servo = ac.ServoModel(kp=25.0, kv=150.0)
run = ac.Run(
    name="square",
    limits=arm.limits.replace(speed=0.25, joint_acceleration=8.0),
    rounding=ac.Rounding(tolerance=1e-3),
    cycle=2e-3,
)
job = ac.Job(
    name="square",
    title="A square in front of a UR5e",
    arm=arm,
    path=path,
    servo=servo,
    plant_servo=servo,
    runs=(run,),
)

# Displacements of the part from its current position [m].
placed = ac.place(job, {"x": np.linspace(-0.1, 0.4, 6), "y": np.linspace(0.0, 0.3, 4)})
print(f"current position: {placed.own.duration:.3f} s")
print(f"best of the grid: {placed.best}: {placed.best.duration:.3f} s")
for kind, count in placed.refusals.items():
    print(f"  {count} positions refused: {kind}")
best_job = placed.placed()  # the job with the part in its best position
