"""Packages whose public names are loaded at first use, so that their import is cheap."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, cast

# Functions in upper packages that lower packages call, as module and name. The root package's
# `__init__` fills it.
METHODS: dict[str, str] = {}


def load_method(name: str) -> Callable[..., Any]:
    """Load the function with this name in `METHODS`."""
    return cast(Callable[..., Any], getattr(import_module(METHODS[name]), name))


def _unknown(package: str, name: str, names: list[str]) -> AttributeError:
    """Make the error for a name that a package does not have."""
    if name.startswith("_"):
        return AttributeError(f"module {package!r} has no attribute {name!r}")
    from armcontour.core.guesses import explain_module_name

    return AttributeError(explain_module_name(package, name, names))


def lazy_names(package: str, home: Mapping[str, str]) -> tuple[Callable[[str], Any], list[str]]:
    """Make `__getattr__` and `__all__` of a package whose names are loaded at first use."""
    module_of: dict[str, str] = {}
    for home_module, names in home.items():
        module_of |= dict.fromkeys(names.split(), home_module)

    def load(name: str) -> Any:
        """Load a public name from its module at first use."""
        if name not in module_of:
            raise _unknown(package, name, sorted(module_of))
        module = module_of[name]
        inside = module.partition(".")[0] != "armcontour"
        value = getattr(import_module(f"{package}.{module}" if inside else module), name)
        setattr(sys.modules[package], name, value)
        return value

    return load, sorted(module_of)
