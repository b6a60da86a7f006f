from armcontour.control.compensation.compensator import CompensationOptions as CompensationOptions
from armcontour.control.compensation.compensator import Inverse as Inverse
from armcontour.control.compensation.compensator import InverseDynamics as InverseDynamics
from armcontour.control.compensation.compensator import METHODS as METHODS
from armcontour.control.compensation.compensator import NoCompensation as NoCompensation
from armcontour.control.compensation.compensator import PolePlacement as PolePlacement
from armcontour.control.compensation.compensator import compensate as compensate
