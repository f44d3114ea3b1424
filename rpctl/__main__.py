"""``python -m rpctl``."""

from rpctl.cli import main

main()
