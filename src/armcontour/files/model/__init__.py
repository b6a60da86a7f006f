"""Reader of CAD models (STEP): their edges become contours, their parts obstacles.

- `cad_model` has `read_model` and the class `Model`, which calls the other modules.
- `edge_rules` and `tool_axis` have what users state: rules that name edges, and the tool axis.
- `edge_picking` lists the edges at which a user can point, and writes rules for them.
- `edge_selection` finds the edges, `edge_chains` joins them, `edge_paths` makes their paths, and
  `axis_fit` points the tool along them.
- `tables` has parts, faces and edges as plain arrays, with which these modules work.
- `kernel_process` starts the kernel process, which makes these tables, and refuses wrong files.
- `step_kernel`, `step_document` and `step_geometry` run in this process; only they import OCCT.
"""

from armcontour.core.lazy import lazy_names

_HOME = {
    "cad_model": "Model ModelEdge ModelPart ModelSeam",
    "edge_rules": "EdgeRule FaceRule",
    "tool_axis": "Bisector FaceNormal",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
