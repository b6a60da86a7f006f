from armcontour.robot.drives.drives import Drives as Drives
from armcontour.robot.drives.response import NominalMotion as NominalMotion
from armcontour.robot.drives.response import Response as Response
from armcontour.robot.drives.response import regular_times as regular_times
from armcontour.robot.drives.response import respond_along as respond_along
from armcontour.robot.drives.response import simulate as simulate
