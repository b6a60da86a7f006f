from armcontour.simulation.robustness.box import Box as Box
from armcontour.simulation.robustness.monte_carlo import Spread as Spread
from armcontour.simulation.robustness.monte_carlo import jitter_of as jitter_of
from armcontour.simulation.robustness.monte_carlo import spread as spread
from armcontour.simulation.robustness.monte_carlo import worst_corner as worst_corner
