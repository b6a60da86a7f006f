"""The public names: they exist, they are sorted, and importing the package costs nothing."""

import subprocess
import sys

import armcontour as ac


def test_every_public_name_exists() -> None:
    for name in ac.__all__:
        assert getattr(ac, name) is not None
    assert ac.__all__ == sorted(ac.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    assert not hasattr(ac, "does_not_exist")


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = "import armcontour, sys; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
