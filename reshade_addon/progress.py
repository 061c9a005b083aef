"""Running a generator of progress to its end."""

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
