"""Run the command line as `python -m armcontour`."""

import sys

if not sys.flags.safe_path:
    # Python puts the current folder first, where its files replace modules of libraries.
    sys.path.append(sys.path.pop(0))

from armcontour.cli import main  # noqa: E402

main()
