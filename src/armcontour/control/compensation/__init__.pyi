from armcontour.control.compensation.compensator import compensate as compensate
from armcontour.control.compensation.inverse import INVERSE as INVERSE
from armcontour.control.compensation.inverse import Inverse as Inverse
from armcontour.control.compensation.inverse_dynamics import InverseDynamics as InverseDynamics
from armcontour.control.compensation.method import CompensationOptions as CompensationOptions
from armcontour.control.compensation.no_compensation import NoCompensation as NoCompensation
