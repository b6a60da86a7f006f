"""Compiled loop over the drives' steps, in which MuJoCo moves the rigid bodies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from armcontour.core.checks import FloatArray
from armcontour.core.kernel_cache import compiled

POINTER = ir.IntType(8).as_pointer()


class Functions(NamedTuple):
    """Addresses of MuJoCo's functions.

    Args:
        step: mj_step.
        kinematics: mj_kinematics.
        com_pos: mj_comPos.
        rne: mj_rne.
    """

    step: int
    kinematics: int
    com_pos: int
    rne: int


class Bodies(NamedTuple):
    """A MuJoCo model and its state; the arrays are views of MuJoCo's memory.

    Args:
        model: Address of the mjModel.
        data: Address of the mjData.
        q: Positions of the model's n joints [rad], (n,).
        dq: Velocities of these joints [rad/s], (n,).
        torque: Applied torques; in the controller, gravity torques at rest [N m], (n,).
    """

    model: int
    data: int
    q: FloatArray
    dq: FloatArray
    torque: FloatArray

    @classmethod
    def from_model(cls, model: Any, data: Any) -> Bodies:
        """Return the bodies of a model and its `data`, valid as long as `data` exists."""
        return cls(model._address, data._address, data.qpos, data.qvel, data.qfrc_applied)


class Loops(NamedTuple):
    """Parameters and integrals of the drives' control loops, see `RigidBodyPlant`.

    Args:
        kp: Position-loop gains [1/s], (dof,).
        kv: Velocity-loop gains [1/s], (dof,).
        ki: Integral gains of the velocity loops [1/s], (dof,).
        integral: Integrals of the velocity errors [rad], (dof,); `advance` updates them.
        step: Time between two computations of the loops [s].
        inertia: Inertias J of the servo [kg m²], (dof,).
        limit: Torque limits [N m], (dof,).
        gravity_feedforward: Whether the controller adds the gravity torque.
        gravity_added: Whether the gravity torque is added after the torque limit.
    """

    kp: FloatArray
    kv: FloatArray
    ki: FloatArray
    integral: FloatArray
    step: float
    inertia: FloatArray
    limit: FloatArray
    gravity_feedforward: bool
    gravity_added: bool


class Rows(NamedTuple):
    """Output of the loop, one row per step.

    Args:
        q: Positions at the start of each step and at the end [rad], (steps + 1, n).
        dq: Velocities at these times [rad/s], (steps + 1, n).
        commanded_acceleration: Accelerations before saturation [rad/s²], (steps, dof).
        commanded_torque: Torques before saturation [N m], (steps, dof).
        torque: Torques after saturation [N m], (steps, dof).
    """

    q: FloatArray
    dq: FloatArray
    commanded_acceleration: FloatArray
    commanded_torque: FloatArray
    torque: FloatArray


def _intrinsic(function: Callable[..., Any]) -> Any:
    """Decorate a function that generates machine code; `intrinsic` itself has no type."""
    return intrinsic(function)


@_intrinsic
def _call(typing: Any, function: Any, model: Any, data: Any) -> Any:
    """Generate a call of `function(model, data)`; all arguments are addresses."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        """Write the machine code of the call."""
        kind = ir.FunctionType(ir.VoidType(), [POINTER, POINTER])
        called = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(called, [builder.inttoptr(x, POINTER) for x in args[1:]])
        return context.get_dummy_value()

    return types.void(function, model, data), generate


@_intrinsic
def _call_rne(typing: Any, function: Any, model: Any, data: Any, result: Any) -> Any:
    """Generate a call of `mj_rne(model, data, 0, result)`; all arguments are addresses."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        """Write the machine code of the call."""
        int32 = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, int32, POINTER])
        called = builder.inttoptr(args[0], kind.as_pointer())
        model, data, result = (builder.inttoptr(x, POINTER) for x in args[1:])
        builder.call(called, [model, data, int32(0), result])
        return context.get_dummy_value()

    return types.void(function, model, data, result), generate


@compiled()
def advance(
    functions: Functions,
    bodies: Bodies,
    controller: Bodies,
    loops: Loops,
    parts: int,
    commands: FloatArray,
    integrated: FloatArray,
    noise: FloatArray,
    first: int,
    end: int,
    runaway_speed: float,
    rows: Rows,
) -> int:
    """Simulate steps `first` to `end - 1`; return `end`, or the step with a runaway joint.

    In each step, the loops compute, with the command u and the measured position q and velocity dq,

    - the velocity error e = k_p (u_i - q) - dq of the integrator, whose command u_i lacks the
      acceleration feed-forward, and the integral z, which grows by e times the step,
    - the demanded acceleration a = k_v (k_p (u - q) - dq + k_i z),
    - the torque J a + gravity, clipped to the torque limit. What the limit removes is taken back
      from z, as in `ServoModel`.

    Args:
        functions: MuJoCo's functions.
        bodies: The simulated arm.
        controller: The controller's model of the arm, at rest.
        loops: Parameters and integrals of the loops.
        parts: Integration steps per step of the drives.
        commands: Commands u [rad], (steps, dof).
        integrated: Commands u_i of the integrators [rad], (steps, dof).
        noise: Noise of measured positions [rad], (steps, dof), or (0, dof) without noise.
        first: First step.
        end: Step before which the simulation ends.
        runaway_speed: Velocity above which joints run away [rad/s].
        rows: Output, which is written.
    """
    dof = len(loops.kp)
    n = len(bodies.q)
    for k in range(first, end):
        for j in range(n):
            rows.q[k, j] = bodies.q[j]
            rows.dq[k, j] = bodies.dq[j]
        for j in range(dof):
            controller.q[j] = bodies.q[n - dof + j]
            if len(noise):
                controller.q[j] += noise[k, j]
        if loops.gravity_feedforward:
            _call(functions.kinematics, controller.model, controller.data)
            _call(functions.com_pos, controller.model, controller.data)
            _call_rne(
                functions.rne, controller.model, controller.data, controller.torque.ctypes.data
            )
        for j in range(dof):
            error = (integrated[k, j] - controller.q[j]) * loops.kp[j] - bodies.dq[n - dof + j]
            loops.integral[j] += loops.step * error
            demanded = (commands[k, j] - controller.q[j]) * loops.kp[j] - bodies.dq[n - dof + j]
            demanded = (demanded + loops.ki[j] * loops.integral[j]) * loops.kv[j]
            gravity = 0.0 if loops.gravity_added else controller.torque[j]
            fed_forward = controller.torque[j] if loops.gravity_added else 0.0
            required = demanded * loops.inertia[j] + gravity
            applied = max(min(required, loops.limit[j]), -loops.limit[j]) + fed_forward
            # Anti-windup of the integrator, as in `ServoModel`.
            excess = (required + fed_forward - applied) / loops.inertia[j]
            loops.integral[j] -= loops.step * excess / loops.kv[j]
            bodies.torque[n - dof + j] = applied
            rows.commanded_acceleration[k, j] = demanded
            rows.commanded_torque[k, j] = required + fed_forward
            rows.torque[k, j] = applied
        for _ in range(parts):
            _call(functions.step, bodies.model, bodies.data)
        speed = 0.0
        for j in range(n):
            speed += bodies.dq[j] ** 2
        # The negation is also true for NaN.
        if not speed < runaway_speed**2:
            return k
    for j in range(n):
        rows.q[end, j] = bodies.q[j]
        rows.dq[end, j] = bodies.dq[j]
    return end
