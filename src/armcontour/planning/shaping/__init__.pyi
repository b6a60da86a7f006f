from armcontour.planning.shaping.shaper import Shaping as Shaping
from armcontour.planning.shaping.shaper import shape as shape
