from armcontour.drives.drives import Drives as Drives
from armcontour.drives.response import Response as Response
from armcontour.drives.response import regular_times as regular_times
from armcontour.drives.response import respond_along as respond_along
from armcontour.drives.simulation import Simulation as Simulation
from armcontour.drives.simulation import simulate as simulate
