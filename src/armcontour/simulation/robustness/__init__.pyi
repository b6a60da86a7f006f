from armcontour.simulation.robustness.box import Uncertainty as Uncertainty
from armcontour.simulation.robustness.monte_carlo import MonteCarloResult as MonteCarloResult
from armcontour.simulation.robustness.monte_carlo import jitter_of as jitter_of
from armcontour.simulation.robustness.monte_carlo import spread as spread
from armcontour.simulation.robustness.monte_carlo import worst_corner as worst_corner
