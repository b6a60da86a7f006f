from armcontour.controllers.controller import Controller as Controller
from armcontour.controllers.controller import Motion as Motion
from armcontour.controllers.controller import PlayedMotion as PlayedMotion
from armcontour.controllers.controller import Stop as Stop
from armcontour.controllers.franka import Franka as Franka
from armcontour.controllers.linuxcnc import LinuxCNC as LinuxCNC
from armcontour.controllers.player import Played as Played
from armcontour.controllers.player import play as play
