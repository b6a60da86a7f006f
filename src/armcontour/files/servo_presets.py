"""Built-in servos by name: measured servos of controllers."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated, Any

from armcontour.core import checks
from armcontour.core.quantities import Choice, Convert
from armcontour.core.yaml_loader import load
from armcontour.files.file_keys import read_keys
from armcontour.robot.servo import ServoModel

# Folder of the built-in servos.
SERVOS = FilePath(__file__).with_name("servos")
SERVO_NAMES = tuple(sorted(x.stem for x in SERVOS.glob("*.yaml")))


def preset_keys(name: str) -> dict[str, Any]:
    """Return the keys of a built-in servo, as in the key `servo` of a job.

    Raises:
        InvalidInput: No servo has this name.
    """
    checks.check_choice("servo", name, SERVO_NAMES)
    text = (SERVOS / f"{name}.yaml").read_text(encoding="utf-8")
    return dict(load(text, name)["servo"])


def servo_preset(name: str) -> ServoModel:
    """Load a built-in servo, as `ServoModel.preset`."""
    servo: ServoModel = read_keys(ServoModel, preset_keys(name))
    return servo


def _load_named(servo: ServoModel | str) -> ServoModel:
    """Return the built-in servo of a name; other values do not change."""
    return servo_preset(servo) if isinstance(servo, str) else servo


# Annotation of the key `servo`: the name of a built-in servo, or a mapping.
ServoKey = Annotated[
    Annotated[str, Choice(SERVO_NAMES)] | ServoModel,
    Convert(_load_named),
]
