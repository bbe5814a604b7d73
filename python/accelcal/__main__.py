"""`python -m accelcal` is the command line."""

from accelcal.cli import main

main()
