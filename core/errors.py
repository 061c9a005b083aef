"""Bad input, told apart from a fit that failed: bad input raises, a failed fit is a value (see `types.Estimate`)."""


class ReshadeError(Exception):
    """Bad input. `str(error)` is one line: what is wrong, then what to do about it.

    problem : what is wrong, a sentence without its full stop
    remedy : what the user can do, a sentence without its full stop
    """

    exit_code = 2

    def __init__(self, problem: str, remedy: str) -> None:
        super().__init__(f"{problem}. {remedy}.")
        self.problem = problem
        self.remedy = remedy


class NothingToLearn(ReshadeError):
    """The input is readable but says nothing about the light (an all-black photo, one pixel, everything clipped)."""

    exit_code = 3
