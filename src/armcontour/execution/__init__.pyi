from armcontour.execution.plant import Plant as Plant
from armcontour.execution.plant import ServoPlant as ServoPlant
from armcontour.execution.plant import execute as execute
from armcontour.execution.rigid_body_plant import RigidBodyPlant as RigidBodyPlant
