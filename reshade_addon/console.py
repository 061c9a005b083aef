"""What the commands have in common on a terminal, without Blender: arguments, progress, how a command ends."""

import argparse
import signal
import sys
from collections.abc import Callable
from typing import NoReturn, TextIO

from ..core.errors import ReshadeError
from ..core.types import Progress

INTERRUPTED = 130


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Raise what argparse found wrong with the arguments."""
        raise ReshadeError(message[:1].upper() + message[1:], f"See '{self.prog} --help'")


class Console:
    """Where progress is told: a line on stderr that is written over, where stderr is a terminal."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._shown = stream.isatty()

    def tell(self, step: Progress) -> None:
        """Show where a computation stands."""
        if self._shown:
            self._stream.write(f"\r\x1b[K{100 * step.fraction:3.0f} %  {step.message}")
            self._stream.flush()

    def clear(self) -> None:
        """Take the line away."""
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()


def ended(run: Callable[[], tuple[int, str]]) -> int:
    """Run a command, say how it ended in one line, and return its exit code."""
    # Blender takes Ctrl-C for itself, as a wish to end a render; here it ends the command.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        code, said = run()
    except ReshadeError as error:
        code, said = error.exit_code, str(error)
    except KeyboardInterrupt:
        code, said = INTERRUPTED, "Interrupted; nothing was written."
    finally:
        if before is not None:  # None: a handler of Blender's own, which Python cannot put back
            signal.signal(signal.SIGINT, before)
    print(said if code == 0 else f"reshade: {said}", file=sys.stdout if code == 0 else sys.stderr, flush=True)
    return code
