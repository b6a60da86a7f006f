"""STEP files, which OCCT writes once per session."""

import pytest


@pytest.fixture(scope="session")
def steps(tmp_path_factory):
    """A folder with the files of `step_parts`."""
    pytest.importorskip("OCP")
    from tests.files.model import step_parts

    folder = tmp_path_factory.mktemp("steps")
    step_parts.saddle(folder / "saddle.step")
    step_parts.frame(folder / "frame.step")
    step_parts.sheet(folder / "sheet.step")
    step_parts.block(folder / "block.step")
    return folder
