from armcontour.files.model.cad_model import Model as Model
from armcontour.files.model.cad_model import ModelEdge as ModelEdge
from armcontour.files.model.cad_model import ModelPart as ModelPart
from armcontour.files.model.cad_model import ModelSeam as ModelSeam
from armcontour.files.model.edge_rules import EdgeRule as EdgeRule
from armcontour.files.model.edge_rules import FaceRule as FaceRule
from armcontour.files.model.tool_axis import Bisector as Bisector
from armcontour.files.model.tool_axis import FaceNormal as FaceNormal
