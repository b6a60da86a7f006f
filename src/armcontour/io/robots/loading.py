"""`load_arm`: load a built-in arm, an arm file or a robot description."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from armcontour import _files
from armcontour.arms.arm import Arm
from armcontour.arms.chain import Payload
from armcontour.arms.serial import SerialArm
from armcontour.errors import InvalidInput
from armcontour.frames import Frame
from armcontour.io.robots.arm_file import read_arm, read_built_in
from armcontour.io.robots.joint_limits import limits_of, override, table_of
from armcontour.io.robots.shapes import with_hulls, with_more_shapes
from armcontour.io.robots.urdf import arm_of_tree, is_description, read_description
from armcontour.io.robots.xacro_file import Value

# Arm files that name an arm file that names an arm file: more of them name themselves.
MOST_DERIVED = 16


def arm_names() -> tuple[str, ...]:
    """Names of the built-in arms."""
    folder = resources.files("armcontour.io.robots") / "library"
    return tuple(sorted(x.name[:-5] for x in folder.iterdir() if x.name.endswith(".yaml")))


def load_arm(
    name: str | FilePath,
    *,
    tip: str | None = None,
    base: str | None = None,
    joint_limits: str | FilePath | None = None,
    tool: Frame | None = None,
    work: Frame | None = None,
    payload: Payload | None = None,
    locked: Mapping[str, float] | None = None,
    packages: Mapping[str, str | FilePath] | None = None,
    arguments: Mapping[str, Value] | None = None,
    srdf: str | FilePath | None = None,
    trust_xacro: bool = False,
) -> Arm:
    """Load an arm by its built-in name, such as "ur5e", or from a file.

    Args:
        name: Built-in name, arm file (.yaml), or robot description (.urdf, .xacro).
        tip: Link at the end of the arm, for a robot description; by default the end of its only
            chain of moving joints.
        base: Fixed link at the start of the arm, for a robot description; by default the root.
        joint_limits: A `joint_limits.yaml` of MoveIt, which replaces limits of the arm's own file.
            Its default scaling factors are not applied.
        tool: The tool frame relative to the tip.
        work: The frame of tool points relative to the base.
        payload: Payload at the tip.
        locked: Positions of locked joints by name, for a robot description [rad or m]; by default
            joints beside the arm stand at 0, or at the end of their range that is nearest to 0.
        packages: Folders of ROS packages by name, for a robot description. Other packages are
            looked for by their `package.xml` near the file; those of a .xacro file first in a
            sourced ROS.
        arguments: Values of the arguments of a .xacro file, by name.
        srdf: A file of MoveIt (.srdf) that says which links may touch each other.
        trust_xacro: Whether a .xacro file may be expanded. Such a file is a program that can run
            any code: trust only files that you would run.

    Raises:
        InvalidInput: No such arm or file, a .xacro file that is not trusted, or a file that does
            not describe an arm.
    """
    _refuse_misuse(name, tool, work, payload)
    file = FilePath(name)
    limits_file = None if joint_limits is None else FilePath(joint_limits)
    if is_description(file):
        tree = read_description(
            file, trust_xacro=trust_xacro, packages=packages, arguments=arguments
        )
        arm: Arm = arm_of_tree(
            tree,
            tip=tip,
            base=base,
            joint_limits=limits_file,
            locked=locked,
            packages=packages,
        )
    else:
        if tip is not None or base is not None or locked or packages or arguments:
            raise InvalidInput(
                f"The arm {name} has no other tip, base, joints to be locked, packages or "
                "arguments: these are chosen of a .urdf or .xacro file."
            )
        arm = _read(str(name), payload, _derived_from(payload, trust_xacro=trust_xacro))
        if limits_file is not None:
            table = table_of(arm.limits, arm.dof)
            override(table, arm.joint_names, limits_file)
            # The file has joint limits only; the arm keeps its other limits.
            own = limits_of(table, arm.joint_names, str(limits_file))
            own = arm.limits.replace(**{key: getattr(own, key) for key in table})
            arm = arm.with_limits(own)
    arm = equip(arm, tool=tool, work=work, payload=payload)
    return arm if srdf is None else with_more_shapes(arm, srdf=FilePath(srdf))


def _refuse_misuse(name: object, tool: object, work: object, payload: object) -> None:
    """Refuse arguments of a wrong type, which would cause unclear errors later."""
    if not isinstance(name, str | FilePath):
        raise InvalidInput(
            f"load_arm needs a name such as 'ur5e', or a file, not {type(name).__name__}."
        )
    for key, value, kind, example in (
        ("tool", tool, Frame, "Frame(position=(0, 0, 0.1))"),
        ("work", work, Frame, "Frame(position=(0.5, 0, 0))"),
        ("payload", payload, Payload, "Payload(mass=2.0)"),
    ):
        if value is not None and not isinstance(value, kind):
            raise InvalidInput(
                f"{key} must be a {kind.__name__}, such as {example}, not {type(value).__name__}."
            )


def _derived_from(
    payload: Payload | None, *, trust_xacro: bool, depth: int = 0
) -> Callable[..., Arm] | None:
    """The function that loads the arm from which another one is derived; None if that is too deep.

    Args:
        payload: As in `read_arm`.
        trust_xacro: Whether a .xacro file may be expanded.
        depth: Number of files that were derived from each other before.
    """
    if depth == MOST_DERIVED:
        return None

    def load(name: str | FilePath, **options: Any) -> Arm:
        if is_description(FilePath(name)):
            return load_arm(name, trust_xacro=trust_xacro, **options)
        if options:
            raise InvalidInput(
                f"The arm {name} has no other {', '.join(options)}: leave that out, or name a "
                ".urdf or .xacro file."
            )
        further = _derived_from(payload, trust_xacro=trust_xacro, depth=depth + 1)
        return _read(str(name), payload, further)

    return load


def _read(name: str, payload: Payload | None, load: Callable[..., Arm] | None) -> Arm:
    """Read a built-in arm or an arm file.

    Args:
        name: Name of the arm or file.
        payload: As in `read_arm`.
        load: As in `read_arm`.
    """
    if name.lower().endswith((".yaml", ".yml")):
        return read_arm(name, _files.read_bytes(name, "arm file"), payload, load)
    if name not in arm_names():
        raise InvalidInput(
            f"There is no built-in arm {name!r}: the built-in arms are {', '.join(arm_names())}; "
            "your own arm goes in a .yaml, .urdf or .xacro file."
        )
    return with_hulls(read_built_in(name, payload), name)


def equip(
    arm: Arm,
    *,
    tool: Frame | None = None,
    work: Frame | None = None,
    payload: Payload | None = None,
) -> Arm:
    """The arm with a tool, a work frame and a payload; None keeps what the arm has.

    Raises:
        InvalidInput: A tool or a work frame for a planar arm.
    """
    if isinstance(arm, SerialArm):
        if tool is not None or payload is not None:
            arm = arm.with_tool(arm.chain.tool if tool is None else tool, payload)
        return arm if work is None else arm.with_work(work)
    if tool is not None or work is not None:
        raise InvalidInput(
            f"The arm {arm.name} moves in the plane and takes no tool or work frame: move the path "
            "instead."
        )
    return arm
