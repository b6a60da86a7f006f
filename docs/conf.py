"""Settings of the site: `make docs`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from armcontour._version import __version__  # noqa: E402
from docs.site import links, mathml, reference  # noqa: E402

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
# A warning says which one it is, so that it can be looked up.
show_warning_types = True
nitpicky = False

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"armcontour {version}"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_math_renderer = "mathml"


def setup(app: Any) -> None:
    """Write the pages of the reference before the others are read, and mend links of files."""
    # Address of the repository, for links to files that are no pages; empty makes them plain text.
    app.add_config_value("repository", os.environ.get("ARMCONTOUR_REPOSITORY", ""), "env")
    app.add_html_math_renderer("mathml", (mathml.inline, None), (mathml.block, None))
    app.connect("builder-inited", lambda app: reference.write(HERE / "reference" / "pages"))
    app.connect("source-read", links.mend)
