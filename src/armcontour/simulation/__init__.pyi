from armcontour.simulation.plant import Plant as Plant
from armcontour.simulation.plant import ServoPlant as ServoPlant
from armcontour.simulation.plant import execute as execute
from armcontour.simulation.rigid_body_plant import RigidBodyPlant as RigidBodyPlant
