from armcontour.planning.shaping.shaper import Shaped as Shaped
from armcontour.planning.shaping.shaper import shape as shape
