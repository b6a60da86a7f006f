"""The command `studio`, up to the server."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from armcontour.cli.options import StudioOptions
from armcontour.cli.serving import open_studio
from armcontour.errors import InvalidInput


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        ("none.yaml", {}, "There is no job file none.yaml"),
        ("none.dxf", {"cell": "ur5e"}, "There is no drawing none.dxf"),
        ("part.csv", {}, "part.csv is a drawing: .*--cell"),
        ("job.yaml", {"cell": "ur5e"}, "job.yaml is a job"),
        (None, {"cell": "ur5e"}, "--cell goes with a drawing"),
    ],
)
def test_what_cannot_be_opened_is_refused_before_anything_starts(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str | None,
    options: dict[str, Any],
    told: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.csv").write_text("x,y\n0,0\n1,0\n")
    (tmp_path / "job.yaml").write_text("name: a\n")
    with pytest.raises(InvalidInput, match=told):
        open_studio(None if name is None else Path(name), StudioOptions(**options))
    assert capsys.readouterr().out == ""


def test_the_address_is_printed_and_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from armcontour.studio import server

    (tmp_path / "job.yaml").write_text("[")
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(server, "listen", lambda port, listen=server.listen: listen(0))
    with pytest.raises(InvalidInput, match="job.yaml"):
        open_studio(tmp_path / "job.yaml", StudioOptions())
    printed = capsys.readouterr().out.splitlines()
    address = printed[0].removeprefix("Studio: ")
    assert address.startswith("http://127.0.0.1:") and len(address.partition("#")[2]) == 32
    assert opened == [address] and "Ctrl+C" in printed[1]


@pytest.mark.parametrize("arguments", [[], ["job.yaml"], ["part.svg", "--cell", "ur5e"]])
def test_nothing_that_computes_is_loaded_before_the_address_is_printed(
    tmp_path: Path, arguments: list[str]
) -> None:
    (tmp_path / "job.yaml").write_text("name: a\n")
    (tmp_path / "part.svg").write_text("<svg/>")
    code = (
        "import sys\n"
        f"sys.argv = ['armcontour', 'studio', '--no-open', *{arguments!r}]\n"
        "from armcontour.cli import console, serving\n"
        "heavy = {'numpy', 'scipy', 'numba', 'pint', 'yaml', 'uvicorn', 'armcontour.io.keys'}\n"
        "def tell(text):\n"
        "    print(*(heavy & set(sys.modules)))\n"
        "    raise KeyboardInterrupt\n"
        "serving.say_at_once = tell\n"
        "from armcontour.cli import main\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, cwd=tmp_path, text=True, timeout=60
    )
    assert done.stdout == "\n", (done.stdout, done.stderr)
