"""Kinematics that the page computes, run by node."""

import atexit
import json
import shutil
import subprocess
import tempfile
from functools import cache
from importlib.util import find_spec
from pathlib import Path as FilePath
from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.frames import Frame
from armcontour.core.render import PALETTE_FILE, jsonable
from armcontour.report.arm_frame import arm_frame
from armcontour.robot.chain import link_poses
from armcontour.studio.server import page_files

URDF = FilePath(__file__).parents[1] / "files" / "robots" / "data" / "robot.urdf"


def find_node():
    """node, or the one that Playwright brings."""
    node = shutil.which("node")
    spec = find_spec("playwright")
    if node is None and spec is not None and spec.origin is not None:
        bundled = FilePath(spec.origin).parent / "driver" / "node"
        node = str(bundled) if bundled.is_file() else None
    return node


NODE = find_node()
pytestmark = pytest.mark.skipif(NODE is None, reason="the page's arithmetic is run by node")


@cache
def page_folder():
    """The files of the page in one folder, as the server has them."""
    folder = FilePath(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder)
    for name, file in page_files().items():
        (folder / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(file, folder / name)
    return folder


def compute(script, arguments=None):
    """Result of a script of the page: `given` are its arguments, `tell` takes its result."""
    start = (
        f"const given = {json.dumps(jsonable(arguments))};"
        "const tell = x => console.log(JSON.stringify(x));"
        f"globalThis.fetch = async () => ({{ json: () => ({PALETTE_FILE.read_text()}) }});"
    )
    command = [NODE, "--input-type=module", "-"]
    code = start + script
    outcome = subprocess.run(
        command, input=code, cwd=page_folder(), capture_output=True, text=True, check=True
    )
    return json.loads(outcome.stdout)


def test_the_page_computes_the_same_link_and_tool_poses():
    work = Frame.rpy([0.3, -0.1, 0.2], [0.1, 0.2, 0.3])
    tool = Frame.rpy([0.0, 0.02, 0.1], [0.0, 0.5, 0.0])
    arms = [
        *map(ac.load_arm, ac.arm_names()),
        ac.load_arm("ur5e").with_work(work).with_tool(tool),
        ac.load_arm(URDF, base="base_link", tip="tcp"),
    ]
    random = np.random.default_rng(19)
    postures = [random.uniform(-3.0, 3.0, (40, arm.dof)) for arm in arms]
    headers = [arm_frame(SimpleNamespace(arm=arm, scene=None)).header for arm in arms]
    chains = compute(
        """
        const { Chain, poseOf } = await import("./kinematics.js");
        tell(given.map(({ joints, tool, base, q }) => {
          const chain = new Chain(joints, tool);
          const based = (x) => poseOf(base).multiply(x).transpose().elements.slice(0, 12);
          return q.map((x) => [...chain.links(x), chain.toolOf(chain.links(x))].map(based));
        }));
        """,
        [
            {"q": q, **{name: header[name] for name in ("joints", "tool", "base")}}
            for q, header in zip(postures, headers, strict=True)
        ],
    )
    for arm, q, header, rows in zip(arms, postures, headers, chains, strict=True):
        poses = np.array(rows).reshape(len(q), -1, 3, 4)
        assert np.abs(poses[:, -1, : arm.dimension, 3] - arm.tool_position(q)).max() < 1e-14
        if arm.dimension == 3:
            assert np.abs(poses[:, -1, :, :3] - arm.pose(q)[1]).max() < 1e-14
        base = np.array(header["base"])
        np.testing.assert_allclose(base @ header["work"], np.eye(4), atol=1e-12)
        if arm.name == "ur5e":
            np.testing.assert_allclose(poses[:, :-1], link_poses(arm.chain, q), atol=1e-12)
            assert [x["link"] for x in header["bodies"]] == [x.link for x in arm.shapes.shapes]


def test_a_frame_contains_all_points_and_is_as_near_as_possible():
    random = np.random.default_rng(3)
    cases = []
    for _ in range(30):
        points = random.normal(size=(random.integers(1, 40), 3)) * random.uniform(0.01, 5.0, 3)
        low, high = random.uniform(0.3, 1.0, (2, 2))
        field = random.uniform(0.1, 0.6)
        cases.append(
            {
                "points": points,
                "picture": {
                    "right": field * random.uniform(0.4, 2.5),
                    "up": field,
                    "across": [-low[0], high[0]],
                    "along": [-low[1], high[1]],
                    "nearest": 0.2,
                },
            }
        )
    cameras = compute(
        """
        const { frame } = await import("./framing.js");
        tell(given.map(({ points, picture }) => frame(points.flat(), picture)));
        """,
        cases,
    )
    for case, camera in zip(cases, cameras, strict=True):
        picture = case["picture"]
        away = camera - case["points"]
        x = -away[:, 0] / away[:, 2] / picture["right"]
        y = -away[:, 1] / away[:, 2] / picture["up"]
        bounds = np.array([[x.min(), x.max()], [y.min(), y.max()]])
        allowed = np.array([picture["across"], picture["along"]])
        assert (bounds[:, 0] >= allowed[:, 0] - 1e-9).all()
        assert (bounds[:, 1] <= allowed[:, 1] + 1e-9).all()
        # Points touch two opposite edges, unless the camera would be too near.
        touches = np.abs(bounds - allowed).max(axis=1).min() < 1e-9
        assert touches or away[:, 2].min() == pytest.approx(picture["nearest"])
        assert away[:, 2].min() >= picture["nearest"] - 1e-12
