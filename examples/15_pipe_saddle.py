"""A seam around a pipe branch: a positioner turns the part, so the torch points downwards."""

from pathlib import Path

import numpy as np

import armcontour as ac

seam = Path(__file__).parent / "drawings" / "pipe_saddle.csv"
# The built-in cell: a UR10e on a rail, a torch, and a positioner that tilts and turns the part.
job = ac.read_job(seam, cell="ur10e_positioner")
result = ac.run(job).runs["compensated"]
data = result.to_data()
print(f"{result.path.length * 1e3:.0f} mm in {data['duration'].value:.2f} s")
print(f"off the seam by {data['off_drawing'].value * 1e3:.2f} mm at most")
print(f"torch axis within {np.degrees(data['tilt'].value):.1f}° of gravity")
q = result.trajectory.q
for name, travel in zip(job.arm.joint_names[:3], np.ptp(q, axis=0), strict=False):
    moved = f"{travel * 1e3:.0f} mm" if name == "rail" else f"{np.degrees(travel):.0f}°"
    print(f"  {name} moves by {moved}")

# A table that does not turn cannot keep the torch near gravity: the turntable would have to move.
hold = {("arm", "preferences", axis, "hold"): 0.0 for axis in ("turn", "tilt")}
try:
    ac.run(ac.read_job(seam, cell="ur10e_positioner", patch=hold))
except ac.Unreachable as error:
    axis = job.arm.joint_names[error.joint]
    print(f"with held axes refused: {axis} would have to be at {np.degrees(error.needed):.0f}°")
