from armcontour.simulation.plant import Plant as Plant
from armcontour.simulation.plant import ServoPlant as ServoPlant
from armcontour.simulation.plant import simulate as simulate
from armcontour.simulation.rigid_body_plant import RigidBodyPlant as RigidBodyPlant
