"""Runs Reshade's command line in Blender as a Python module. `.venv/bin/reshade` starts this."""

import sys

from reshade.reshade_addon.cli import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
