"""Runs Reshade's command line in Blender as a Python module. `.venv/bin/reshade` starts this."""

import sys


def main(argv: list[str]) -> int:
    """Run a command and return its exit code; Blender takes a second to start, so only where it is needed."""
    from reshade.reshade_addon import dehighlight

    if argv[:1] == [dehighlight.COMMAND] and not any(argument.startswith("--scene") for argument in argv):
        return dehighlight.main(argv[1:])
    from reshade.reshade_addon import cli

    return cli.main(argv)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
