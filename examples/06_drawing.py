"""A DXF drawing on a planar arm: the program has leads, switches a laser and resumes a cut."""

import dataclasses
from pathlib import Path

import armcontour as ac
from armcontour.program import Lead, Switch

drawing = Path(__file__).parent / "drawings" / "gasket.dxf"
# Position of the drawing's origin relative to the base of the arm [m].
place = ac.Frame(position=(0.28, 0.08, 0.0))
gasket = ac.read_path(drawing, ac.ReadOptions(layers=["CUT"]), frame=place)
print(f"{gasket.source}: {len(gasket.contours)} contours, {gasket.length * 1e3:.0f} mm")

# Quarter circles in the waste lead onto every contour and off it.
lead = Lead(length=4e-3, shape="arc")
process = ac.Process(
    overlap=1e-3,
    lead_in=lead,
    lead_out=lead,
    switch=Switch(name="laser", on_lead=0.02),  # the laser takes 20 ms to switch on
)
arm = ac.load_arm("pmk3s")
servo = ac.ServoModel(kp=25.0, kv=150.0)
limits = arm.limits.replace(speed=0.05, centripetal_acceleration=0.09)


def cut(process: ac.Process) -> ac.SetPoints:
    """Plan, compensate, simulate and evaluate the drawing with a process."""
    objective = ac.prepare(gasket, process)
    program = ac.round_corners(objective, tolerance=2e-4)
    # The plan leaves a tenth of the joint acceleration to the servo.
    planned = ac.plan(program, arm, limits, ac.Optimal(reserve=0.1))
    set_points = ac.compensate(planned, servo, ac.Inverse(), cycle=4e-3)
    executed = ac.simulate(set_points, ac.ServoPlant(arm, servo))
    evaluation = ac.evaluate(executed, program, objective=objective, limits=limits)
    worst = max(evaluation.contours, key=lambda x: x.max)
    name = program.contours[evaluation.contours.index(worst)].name
    print(f"{planned.duration:.1f} s, contour error {worst.max * 1e3:.4f} mm at most, on {name}")
    return set_points


set_points = cut(process)
for event in set_points.trajectory.events[:2]:
    state = "on" if event.value else "off"
    print(f"  {event.name} {state} at {event.t:.3f} s, {event.due - event.t:.3f} s ahead")

print("From 500 mm on, after a stop:")
cut(dataclasses.replace(process, resume_at=0.5))
