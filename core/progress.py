"""Progress of long computations: generators that yield `Progress` and return their result."""

from collections.abc import Callable, Generator
from typing import TypeVar

from .types import Progress

Step = TypeVar("Step")
Result = TypeVar("Result")


def drain(steps: Generator[Step, None, Result], tell: Callable[[Step], None] | None = None) -> Result:
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


def watched(
    steps: Generator[float, None, Result], begin: float, end: float, message: str
) -> Generator[Progress, None, Result]:
    """Turn the steps of a computation of unknown length into progress that nears `end`."""
    count = 0
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return done.value
        count += 1
        yield Progress(end - (end - begin) * 0.85**count, message)


def shifted(steps: Generator[Progress, None, Result], begin: float, end: float) -> Generator[Progress, None, Result]:
    """Tell a part's progress as that of the whole."""
    while True:
        try:
            step = next(steps)
        except StopIteration as done:
            return done.value
        yield Progress(begin + (end - begin) * step.fraction, step.message)
