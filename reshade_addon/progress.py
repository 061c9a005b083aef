"""Generators of progress: a computation yields `Progress` and returns its result."""

from collections.abc import Callable, Generator
from typing import TypeVar

from ..core.types import Progress

Result = TypeVar("Result")


def drain(steps: Generator[Progress, None, Result], tell: Callable[[Progress], None] | None = None) -> Result:
    """Run a computation to its end, telling `tell` of each step where given, and return its result."""
    try:
        while True:
            step = next(steps)
            if tell:
                tell(step)
    except StopIteration as end:
        return end.value
    finally:
        steps.close()


def part(steps: Generator[Progress, None, Result], start: float, end: float) -> Generator[Progress, None, Result]:
    """Run a computation as a part of a longer one, from fraction `start` to `end` of it, and return its result."""
    while True:
        try:
            step = next(steps)
        except StopIteration as stop:
            return stop.value
        yield Progress(start + (end - start) * step.fraction, step.message)
