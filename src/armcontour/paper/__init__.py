"""The paper's method, which is the baseline, and the conventional method that it compares with.

Munasinghe, Nakamura, Goto, Kyura: "Optimum Contouring of Industrial Robot Arms Under Assigned
Velocity and Torque Constraints". docs/method.md corrects its misprints. Its equations, by number:

- (1)-(4), kinematics of a planar arm: `armcontour.robot.planar`
- (5)-(7), servo with saturation: `armcontour.robot.servo`, `armcontour.simulation.ServoPlant`
- (8), (9), limits of joint acceleration and tool speed: `armcontour.robot.limits`
- (10)-(15), arcs at corners: `armcontour.geometry.rounding`
- (16), speed of a corner: `timing._find_junctions`; (17), motion along it: `timing._arc_part`
- (18)-(20), maximum joint acceleration, MAC and MDC: `timing.run_laps`; (21): `laws.LineLaw`
- (22), (23), end of both passes at the assigned velocity: `timing.Pass.last_within`
- (24), (25), uniform tool acceleration between them, AVC: `timing.PaperLine._make_middle`
- (26), compensator: `pole_placement`
- (27), (28), joint motion from tool motion: `armcontour.motion.JointPath`

To read the method, begin with `timing.plan_paper` and `pole_placement.place_poles`.
"""

from armcontour.core.lazy import lazy_names

_HOME = {
    "conventional": "Conventional",
    "pole_placement": "PolePlacement",
    "timing": "Paper",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
