"""Settings of the site: `make docs`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from docutils import nodes

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from docs.site import links, mathml, types, written  # noqa: E402

from armcontour._version import __version__  # noqa: E402

project = "armcontour"
author = "the developers of armcontour"
copyright = author
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
root_doc = "index"
exclude_patterns = ["_build", "site"]
# Blocks without a language are commands and outputs, not Python.
highlight_language = "none"
# A warning says which one it is, so that it can be looked up.
show_warning_types = True
# Two dashes are an option, and quotes belong to code.
smartquotes = False
# Code in docstrings is a link where it is the name of something.
default_role = "py:obj"

myst_enable_extensions = ["dollarmath", "tasklist"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
autodoc_preserve_defaults = True
# site/types.py writes them, as the code has them.
autodoc_typehints = "none"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = f"armcontour {version}"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_js_files = [("site.js", {"defer": "defer"})]
html_copy_source = False
html_show_sphinx = False
html_math_renderer = "mathml"
linkcheck_timeout = 20
linkcheck_retries = 2


def setup(app: Any) -> None:
    """Write generated pages before Sphinx reads the others, and replace links to files."""
    # Address of the repository, for links to files that are no pages; empty makes them plain text.
    app.add_config_value("repository", os.environ.get("ARMCONTOUR_REPOSITORY", ""), "env")
    app.add_html_math_renderer("mathml", (mathml.inline, None), (mathml.block, None))
    app.connect("builder-inited", lambda app: written.write())
    app.connect("source-read", links.mend)
    # Before napoleon reads docstrings, whose priority is 500.
    app.connect("autodoc-process-docstring", types.add_types, priority=400)
    app.connect("doctree-resolved", show_dashes)
    # After the theme has made its navigation.
    app.connect("html-page-context", give_levels, priority=900)


def show_dashes(app: Any, doctree: Any, name: str) -> None:
    """Write a dash, instead of two hyphens, between an argument and its description."""
    for text in list(doctree.findall(lambda x: isinstance(x, nodes.Text) and x == " -- ")):
        text.parent.replace(text, nodes.Text(" – "))


def give_levels(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Add the levels of headings in the navigation, which the theme does not state."""
    tree = context.get("furo_navigation_tree", "")
    context["furo_navigation_tree"] = tree.replace(
        'role="heading"', 'role="heading" aria-level="2"'
    )
