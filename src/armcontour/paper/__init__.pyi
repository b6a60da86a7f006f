from armcontour.paper.conventional import Conventional as Conventional
from armcontour.paper.pole_placement import PolePlacement as PolePlacement
from armcontour.paper.timing import Paper as Paper
