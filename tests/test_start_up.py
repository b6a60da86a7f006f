"""Modules that are loaded at start-up."""

import os
import subprocess
import sys

import pytest

# Prints the modules that a statement loads, one a line. Site packages load some before it.
LOADED = """
import atexit, os, sys
before = set(sys.modules)
{statement}
names = sorted(set(sys.modules) - before)
open(sys.argv.pop(), "w").write("\\n".join(names))
"""
COMMAND = """
sys.argv[1:1] = {arguments}
from armcontour.cli import main
sys.stdout = open(os.devnull, "w")
try:
    main()
except SystemExit:
    pass
del sys.argv[1:-1]
"""
# What typer needs to print help; its versions differ.
TYPER = {"typer", "annotated_doc", "click", "colorama", "shellingham", "typing_extensions"}
NOT_COUNTED = ("__editable", "_sysconfigdata")
# Maximum number of own modules that an import loads: the package and its lazy names.
OWN_OF_IMPORT = 3
# The same for `--help`: also the commands and what they print with.
OWN_OF_HELP = 32
# The same for the help of one command.
OWN_OF_COMMAND = 21
# Maximum numbers of modules of the standard library that an import and `--help` load. Python 3.14
# needs more for the same imports than 3.11.
STANDARD_OF_IMPORT = 40
STANDARD_OF_HELP = 125


def loaded(statement, folder):
    """Modules that a statement loads: own ones, of the standard library, and other packages."""
    file = folder / "modules.txt"
    code = LOADED.format(statement=statement)
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    subprocess.run([sys.executable, "-c", code, str(file)], check=True, env=environment)
    names = file.read_text(encoding="utf-8").split()
    package_modules = {x for x in names if x.partition(".")[0] == "armcontour"}
    standard = {x for x in names if x.partition(".")[0] in sys.stdlib_module_names}
    # Without finders of installed packages, and files that are named after the system.
    others = (x for x in {*names} - package_modules - standard if not x.startswith(NOT_COUNTED))
    return package_modules, standard, {x.partition(".")[0] for x in others}


def test_importing_the_package_loads_its_names_only(tmp_path):
    package_modules, standard, packages = loaded("import armcontour", tmp_path)
    assert len(package_modules) <= OWN_OF_IMPORT, package_modules
    assert len(standard) <= STANDARD_OF_IMPORT, standard
    assert not packages


def test_help_loads_only_the_commands_and_typer(tmp_path):
    package_modules, standard, packages = loaded(COMMAND.format(arguments=["--help"]), tmp_path)
    assert "armcontour.cli.commands" in package_modules
    assert len(package_modules) <= OWN_OF_HELP, package_modules
    assert len(standard) <= STANDARD_OF_HELP, standard
    assert packages <= TYPER


def test_help_texts_of_options_are_read_without_pydantic(tmp_path):
    arguments = ["check", "none.csv", "--arm", "ur5e", "--noise", "1 mrad"]
    assert "pydantic" not in loaded(COMMAND.format(arguments=arguments), tmp_path)[2]


@pytest.mark.parametrize("command", ["run", "check", "studio"])
def test_help_of_a_command_loads_only_its_options(tmp_path, command):
    package_modules, _, packages = loaded(COMMAND.format(arguments=[command, "--help"]), tmp_path)
    assert len(package_modules) <= OWN_OF_COMMAND, package_modules
    assert packages <= TYPER
