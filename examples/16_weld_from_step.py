"""From a STEP file to a weld: the seam between two parts, with the torch on its bisector."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.XCAFDoc import XCAFDoc_DocumentTool

import armcontour as ac
from armcontour.files.model import Bisector, EdgeRule


def write_bracket(file):
    """Write a tube on a plate, as a CAD program does; lengths are in mm."""
    up = gp_Ax2(gp_Pnt(0, 0, 10), gp_Dir(0, 0, 1))
    outside, inside = (BRepPrimAPI_MakeCylinder(up, radius, 90).Shape() for radius in (30, 26))
    post = BRepAlgoAPI_Cut(outside, inside).Shape()
    plate = BRepPrimAPI_MakeBox(gp_Pnt(-80, -60, 0), gp_Pnt(80, 60, 10)).Shape()
    document = TDocStd_Document(TCollection_ExtendedString("XCAF"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    for name, shape in (("plate", plate), ("post", post)):
        TDataStd_Name.Set_s(shapes.AddShape(shape, False), TCollection_ExtendedString(name))
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    writer.Transfer(document)
    writer.Write(str(file))


with TemporaryDirectory() as folder:
    file = Path(folder) / "bracket.step"
    write_bracket(file)
    model = ac.read_model(file)
    for part in model.parts:
        size = " x ".join(f"{x * 1e3:.0f}" for x in np.ptp(part.extent, axis=0))
        print(f"{part.name}: {size} mm, {part.faces} faces")
    # The seam inside the tube is left out, because it is not free over 100 mm.
    rule = EdgeRule(seams=("post", "plate"), open=0.1)
    program = model.program(rule, axis=Bisector(travel=np.radians(-10)))
    # The built-in cell: a UR10e on a rail, a torch, and a positioner that tilts and turns the part.
    keys = {
        ("path", "edges"): {"seams": ["post", "plate"], "open": "100 mm"},
        ("path", "orientation"): {"bisector": {"travel": "-10 deg"}},
    }
    job = ac.read_job(file, cell="ur10e_positioner", patch=keys)
    result = ac.run(job).runs["compensated"]

(seam,) = program.contours
print(f"{seam.name}: {seam.path.length * 1e3:.0f} mm, closed: {seam.closed}")
data = result.to_data()
print(f"planned in {data['duration'].value:.2f} s")
print(f"off the seam by {data['off_drawing'].value * 1e3:.2f} mm at most")
print(f"stops inside the seam: {len(result.path.contours[0].path.stops)}")
print(f"nothing comes nearer than {data['clearance.low'].value * 1e3:.1f} mm")
