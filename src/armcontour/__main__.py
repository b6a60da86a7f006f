"""Run the command line as `python -m armcontour`."""

from armcontour.cli import main

main()
