"""Files that are written whole or not at all: each is made beside its final place and moved there at the very end."""

import os
import tempfile
from pathlib import Path
from types import TracebackType

from ..core.errors import ReshadeError


class Outputs:
    """A set of output files that appear together when the `with` block ends without an error, and otherwise never.

    Files that were there before stay as they are until then. A file that was asked for but never written (it is
    empty at the end) does not appear.
    """

    def __init__(self) -> None:
        self._beside: dict[Path, Path] = {}

    def path(self, final: str | Path) -> Path:
        """Return where to write what shall end up at `final`: an empty file beside it, of the same extension.

        Raises ReshadeError where the folder is missing or cannot be written to.
        """
        final = Path(final).absolute()
        if final in self._beside:
            raise ReshadeError(f"Two outputs have the name '{final.name}'", "Give each output its own name")
        if final.is_dir():
            raise ReshadeError(f"The output '{final}' is a folder", "Name a file")
        try:
            handle, beside = tempfile.mkstemp(prefix=f".{final.stem}-", suffix=final.suffix, dir=final.parent)
        except FileNotFoundError:
            raise ReshadeError(f"The output folder '{final.parent}' does not exist", "Create it first") from None
        except OSError as error:
            raise ReshadeError(
                f"The output folder '{final.parent}' cannot be written to ({error.strerror})", "Choose another folder"
            ) from None
        os.close(handle)
        # mkstemp makes files private to the user; an output is as readable as any new file of theirs.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(beside, 0o666 & ~mask)
        self._beside[final] = Path(beside)
        return Path(beside)

    def __enter__(self) -> "Outputs":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                for final, beside in self._beside.items():
                    if beside.stat().st_size:
                        os.replace(beside, final)
        finally:
            for beside in self._beside.values():
                beside.unlink(missing_ok=True)
