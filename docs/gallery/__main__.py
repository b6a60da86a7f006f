"""Draw the pictures of the gallery: `python -m docs.gallery [NAME ...]` runs examples."""

from __future__ import annotations

import io
import runpy
import sys
from contextlib import redirect_stdout

from docs.figures import style
from docs.gallery import pages, pictures

if __name__ == "__main__":
    for name in sys.argv[1:] or pages.SHOWN:
        with redirect_stdout(io.StringIO()):
            variables = runpy.run_path(str(pages.EXAMPLES / f"{name}.py"), run_name="__main__")
        style.save(getattr(pictures, f"draw_{name[:2]}")(variables), pages.FOLDER / f"{name}.svg")
