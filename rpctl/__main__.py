"""``python -m rpctl``."""

from rpctl.cli.app import main

main()
