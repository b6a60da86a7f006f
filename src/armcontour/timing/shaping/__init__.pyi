from armcontour.timing.shaping.shaper import Shaping as Shaping
from armcontour.timing.shaping.shaper import shape as shape
