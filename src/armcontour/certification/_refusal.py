"""The refusal of a certificate: the limit that binds, and what would help."""

from __future__ import annotations

from typing import NoReturn

from armcontour.certification._search import Search
from armcontour.certification._uses import SPEED_SLACK
from armcontour.errors import NotRealizable

# Smaller shares of an error are not said.
SAID = 0.01


def refuse(search: Search) -> NoReturn:
    """Refuse a certificate after a search, with the limit that binds and what would help.

    Raises:
        NotRealizable: Always.
    """
    setting, goal = search.setting, search.goal
    kind, ratio = search.binds
    slow = f"within {goal.slowest:g} times the {search.optimum:.4g} s of the uncertified optimum"
    longer = "a larger slowest"
    hold = setting.servo.interpolation == "step"
    shorter = "linear interpolation" if hold else "a shorter command interval"
    # Where nothing makes up for the lag of the servo, errors are those of the lag.
    lags = setting.run.compensation == "none"
    follow = "compensate the lag of the servo" if lags else f"take {shorter}"
    if not kind:
        raise NotRealizable(
            f"No plan {slow} is certified: smoothing over the command interval alone takes longer; "
            f"take {longer}.",
            limit="slowest",
            allowed=goal.slowest,
        )
    if kind == "acceleration":
        if setting.run.compensation == "inverse_dynamics" and not setting.bodies:
            shorter = "compensation inverse, as inverse_dynamics is for rigid bodies"
        raise NotRealizable(
            f"No plan {slow} is certified: its set-points would need {ratio:.4g} times a joint's "
            f"acceleration limit, as they come every {search.setting.run.period * 1e3:g} ms"
            f"{' and are held' if hold else ''}: take {shorter}, saturation: report, or {longer}.",
            limit="joint_acceleration",
            needed=ratio,
            allowed=1.0,
        )
    if kind == "speed":
        raise NotRealizable(
            f"No plan {slow} is certified: a bound of its speed, or a command outside a joint's "
            f"range, is exceeded by {ratio - 1:.2g} of it: raise the limit, keep the path further "
            f"from the ends of the joints' ranges, or take {longer}.",
            limit="speed",
            needed=ratio,
            allowed=1.0,
        )
    if kind == "torque":
        _refuse_torque(search, ratio, slow)
    if kind == "tool":
        _refuse_tool_speed(ratio, slow, follow)
    # Trials with a smaller error exceeded another limit, or only an estimate of them was inside.
    reached = search.reached if search.reached > setting.budget else ratio * setting.budget
    if kind == "box" and reached <= setting.budget:
        reached = search.outside
    over = " of the worst robot of the box" if kind == "box" else ""
    mend = _mend_box(search) if kind == "box" else follow
    raise NotRealizable(
        f"No plan {slow} is certified: the largest contour error{over} comes down to "
        f"{reached * 1e3:.4g} mm, and {setting.budget * 1e3:.4g} mm is allowed: {mend}, "
        f"take {longer}, or allow more.",
        limit="contour error",
        needed=reached,
        allowed=setting.budget,
    )


def _mend_box(search: Search) -> str:
    """What helps against errors over a box; on rigid bodies, what each unknown takes first."""
    closer = "know the robot more closely (a smaller box), slow down the assigned velocity"
    if search.shares is None:
        return closer
    largest = sorted(search.shares.items(), key=lambda x: -x[1])
    least = SAID * sum(search.shares.values())
    parts = ", ".join(f"{name} {value * 1e3:.3g} mm" for name, value in largest if value > least)
    box, first = search.setting.box, largest[0][0]
    if first == "payload" and box is not None and not box.payload_known:
        closer = f"let the controller weigh its payload (payload_known: true), or {closer}"
    return f"the linear model of the last plan has {parts}; {closer}"


def _refuse_torque(search: Search, ratio: float, slow: str) -> NoReturn:
    """Refuse a certificate because drives of rigid bodies saturate.

    Raises:
        NotRealizable: Always.
    """
    limits = search.setting.limits
    mend = (
        "raise joint_torque"
        if limits.joint_torque is not None
        else "give the limits joint_torque (without it drives are as strong as the acceleration "
        "limits need them, with no friction and no payload)"
    )
    raise NotRealizable(
        f"No plan {slow} is certified: a robot's drive would need {ratio:.4g} times its torque "
        f"limit: {mend}, lower the acceleration limits, or take a smaller box.",
        limit="joint_torque",
        needed=ratio,
        allowed=1.0,
    )


def _refuse_tool_speed(ratio: float, slow: str, follow: str) -> NoReturn:
    """Refuse a certificate because the executed tool is too fast for its place.

    Args:
        ratio: What it took of the assigned velocity, as a ratio of squares.
        slow: How slow a plan may be, in words.
        follow: What helps the tool to follow the plan more closely, in words.

    Raises:
        NotRealizable: Always.
    """
    faster, allowed = (1 + SPEED_SLACK) * ratio**0.5, 1 + SPEED_SLACK
    raise NotRealizable(
        f"No plan {slow} is certified: the executed tool runs at {faster:.5g} times the velocity "
        f"that is assigned where it is, and {allowed:g} times are allowed: "
        f"{follow}, let the assigned velocity fall in smaller steps, or take a larger slowest.",
        limit="speed",
        needed=faster,
        allowed=allowed,
    )
