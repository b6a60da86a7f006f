"""Creation of the arm that the key `arm` of a job file describes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np

from armcontour.core.errors import InvalidInput, error_context, key_context
from armcontour.core.file_access import ENDINGS
from armcontour.core.frames import Frame
from armcontour.core.quantities import Quantity, read_quantity
from armcontour.core.text import Keys, key_text
from armcontour.files.job_model import ArmModel, FrameModel, PreferenceModel, ToolModel
from armcontour.files.robots.arm_loading import load_arm, with_more_shapes
from armcontour.files.robots.urdf_tree import DESCRIPTION
from armcontour.files.scene_file import assumed_tool, more_link_shapes, rotation_of, tool_shapes
from armcontour.robot import Arm, SerialArm
from armcontour.robot.bodies import place_payload
from armcontour.robot.preferences import JointPreference
from armcontour.robot.preferred_chain import index_of
from armcontour.robot.scene import LinkShape

# Extensions by which a value is a file. Files with unsupported extensions get their own message.
ARM_FILES = (".yaml", ".yml", DESCRIPTION, *ENDINGS)

# Positions of revolute and prismatic joints in preferences.
ANGULAR_POSITION = Quantity("rad", "10 deg")
LINEAR_POSITION = Quantity("m", "0.3 m")


def arm_of(model: str | ArmModel, folder: FilePath, part: Frame | None = None) -> Arm:
    """Load the arm of a job, with its tool, work frame, payload and external axes.

    Args:
        model: The value of the key `arm`.
        folder: Folder against which relative file names are resolved.
        part: Frame of the part in the work frame, which is `path.frame` in a job; by default the
            work frame. The load of a positioner is given in it.
    """
    if isinstance(model, str):
        location = folder / model if model.lower().endswith(ARM_FILES) else model
        return load_arm(location)
    arm = _with_external_axes(_bare_arm(model, folder), model, part or Frame())
    if model.preferences or model.prefer is not None:
        arm = _with_preferences(arm, model)
    # Files of shapes are read now; hulls are computed at the first use of the shapes.
    shapes: tuple[LinkShape, ...] = ()
    if model.shapes is not None:
        shapes = more_link_shapes(model.shapes, folder, arm)
    if model.tool is not None:
        if model.tool.shapes is not None:
            shapes += tool_shapes(model.tool.shapes, folder, arm)
        elif arm.knows_shapes:
            shapes += assumed_tool(arm)
    return with_more_shapes(arm, shapes, None if model.srdf is None else folder / model.srdf)


def _bare_arm(model: ArmModel, folder: FilePath) -> Arm:
    """Load the arm of a job without the external axes and shapes that the job adds."""
    if (model.name is None) == (model.file is None):
        raise InvalidInput("arm requires either name, the name of a built-in arm, or file.")
    if model.file is not None and not model.file.lower().endswith(ARM_FILES):
        raise InvalidInput(
            f"arm.file must have the extension .urdf or .yaml, but is {model.file!r}."
        )
    # A tool that specifies only shapes does not change the tool frame of the arm.
    tool = None
    if model.tool is not None and model.tool != ToolModel(shapes=model.tool.shapes):
        tool = frame_of("arm.tool", model.tool)
    work = None if model.work is None else frame_of("arm.work", model.work)
    key, name = ("name", str(model.name)) if model.file is None else ("file", folder / model.file)
    with error_context("", "arm", key):
        # `arm_of` reads the SRDF after it has added the shapes of the job.
        return load_arm(
            name,
            tip=model.tip,
            base=model.base,
            part=model.part,
            tilt=model.tilt,
            joint_limits=None if model.joint_limits is None else folder / model.joint_limits,
            calibration=None if model.calibration is None else folder / model.calibration,
            tool=tool,
            work=work,
            payload=model.payload,
        )


def _with_external_axes(arm: Arm, model: ArmModel, part: Frame) -> Arm:
    """Add rail and positioner to an arm; the positioner's load is in the frame `part`."""
    if model.rail is None and model.positioner is None:
        return arm
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"The planar arm {arm.name} does not support external axes. Remove arm.rail and "
            "arm.positioner."
        )
    if model.rail is not None:
        arm = arm.with_rail(model.rail)
    if model.positioner is None:
        return arm
    load = model.positioner.part
    if load is None:
        return arm.with_positioner(model.positioner)
    # `with_positioner` expects the load in the work frame, which is fixed to the table.
    return arm.with_positioner(replace(model.positioner, part=place_payload(load, part)))


def _with_preferences(arm: Arm, model: ArmModel) -> SerialArm:
    """Add the preferences of a job to an arm with its external axes."""
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"The planar arm {arm.name} does not support preferences, because a path determines "
            "both of its joints. Remove arm.preferences and arm.prefer; limits.joint_lower and "
            "limits.joint_upper narrow the ranges of its joints.",
            key=("arm", "preferences" if model.preferences else "prefer"),
        )
    preferences = {name: _preference(arm, name, x) for name, x in model.preferences.items()}
    with key_context("arm", "preferences"):
        return arm.with_preferences(preferences, prefer=model.prefer)


def _preference(arm: SerialArm, name: str, model: PreferenceModel) -> JointPreference:
    """Make the preference for a joint, whose kind determines the units of its positions."""
    keys = ("arm", "preferences", name)
    with key_context(*keys[:2]):
        joint = index_of(arm.chain, arm.name, name)
    quantity = LINEAR_POSITION if arm.chain.slides[joint] else ANGULAR_POSITION
    ends = None
    if model.range is not None:
        lower, upper = (_position((*keys, "range"), x, quantity) for x in model.range)
        ends = lower, upper
    hold = None if model.hold is None else _position((*keys, "hold"), model.hold, quantity)
    with key_context(*keys):
        return JointPreference(hold=hold, weight=model.weight, range=ends, still=model.still)


def _position(keys: Keys, value: float | str, quantity: Quantity) -> float:
    """Convert a position of a joint from a file to rad or m; `keys` is its key path."""
    try:
        return read_quantity(value, quantity)
    except ValueError as error:
        raise InvalidInput(f"{key_text(keys)}: {error}.", key=keys, value=value) from None


def frame_of(key: str, model: FrameModel) -> Frame:
    """Return the frame of a model; a missing position or rotation is zero."""
    turned = rotation_of(key, model)
    return Frame(
        position=np.array(model.position or [0.0, 0.0, 0.0]),
        rotation=np.eye(3) if turned is None else turned,
    )
