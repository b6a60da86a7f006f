"""The command `studio`, up to the server."""

import subprocess
import sys
from pathlib import Path

import pytest

from armcontour.cli.options import StudioOptions
from armcontour.cli.serving import open_studio
from armcontour.errors import InvalidInput


def test_wrong_files_are_refused_before_anything_starts(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.csv").write_text("x,y\n0,0\n1,0\n")
    (tmp_path / "job.yaml").write_text("name: a\n")
    for name, options, words in (
        ("none.yaml", {}, "There is no job file none.yaml"),
        ("none.dxf", {"cell": "ur5e"}, "There is no drawing none.dxf"),
        ("part.csv", {}, "part.csv is a drawing: .*--cell"),
        ("job.yaml", {"cell": "ur5e"}, "job.yaml is a job"),
        (None, {"cell": "ur5e"}, "--cell goes with a drawing"),
    ):
        with pytest.raises(InvalidInput, match=words):
            open_studio(None if name is None else Path(name), StudioOptions(**options))
    assert capsys.readouterr().out == ""


def test_the_address_is_printed_and_opened(tmp_path, monkeypatch, capsys):
    from armcontour.studio import server

    (tmp_path / "job.yaml").write_text("[")
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(server, "listen", lambda port, listen=server.listen: listen(0))
    with pytest.raises(InvalidInput, match="job.yaml"):
        open_studio(tmp_path / "job.yaml", StudioOptions())
    printed = capsys.readouterr().out.splitlines()
    address = printed[0].removeprefix("Studio: ")
    assert address.startswith("http://127.0.0.1:") and len(address.partition("#")[2]) == 32
    assert opened == [address] and "Ctrl+C" in printed[1]


ADDRESS = """
import sys
sys.argv = ['armcontour', 'studio', '--no-open', 'part.svg', '--cell', 'ur5e']
from armcontour.cli import console, serving
heavy = {'numpy', 'scipy', 'numba', 'pint', 'yaml', 'uvicorn', 'armcontour.io.keys'}
def tell(text):
    print(*(heavy & set(sys.modules)))
    raise KeyboardInterrupt
serving.say_at_once = tell
from armcontour.cli import main
main()
"""


def test_nothing_that_computes_is_loaded_before_the_address_is_printed(tmp_path):
    (tmp_path / "part.svg").write_text("<svg/>")
    line = [sys.executable, "-c", ADDRESS]
    done = subprocess.run(line, capture_output=True, cwd=tmp_path, text=True)
    assert done.stdout == "\n", (done.stdout, done.stderr)
