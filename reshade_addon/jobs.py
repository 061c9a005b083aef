"""Running a long computation from an operator: step by step where there is an interface, at once where there is none.

The scene is changed only when the computation has ended well, so that Esc leaves it as it was.
"""

from collections.abc import Generator
from time import perf_counter
from typing import Any

import bpy

from ..core.errors import ReshadeError
from ..core.progress import drain
from ..core.types import Progress

STEP = 0.05  # seconds the interface may wait
_LOOKING = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM", "NDOF_MOTION", "MOUSEMOVE"}


class Job:
    """Mix-in for an operator with a long computation.

    A subclass gives `steps`, which computes and leaves the scene as it is, and `finish`, which applies the result and
    returns what to tell the user. Either may raise ReshadeError.
    """

    _steps: Generator[Progress, None, Any] | None = None
    _timer: bpy.types.Timer | None = None

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, Any]:
        """Compute, yielding progress; return the result."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, result: Any) -> str:
        """Apply the result to the scene; return what to tell the user."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run to the end at once: for scripts and without an interface."""
        try:
            self.report({"INFO"}, self.finish(context, drain(self.steps(context))))
        except ReshadeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Start the computation and let the interface go on."""
        if bpy.app.background:
            return self.execute(context)
        manager = context.window_manager
        self._steps = self.steps(context)
        self._timer = manager.event_timer_add(0.01, window=context.window)
        manager.reshade.running = type(self).__name__
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Compute for a moment on each tick of the timer; the view can be turned meanwhile."""
        if event.type == "ESC" and event.value == "PRESS":
            self._close(context)
            self.report({"INFO"}, "Cancelled; the scene is as it was")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"} if event.type in _LOOKING else {"RUNNING_MODAL"}
        try:
            until, now = perf_counter() + STEP, 0.0
            while now < until:
                step = next(self._steps)
                now = perf_counter()
        except StopIteration as end:
            self._close(context)
            return self._finished(context, end.value)
        except ReshadeError as error:
            self._close(context)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        except BaseException:
            self._close(context)
            raise
        self._tell(context, step)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when the window goes away."""
        self._close(context)

    def _finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        try:
            self.report({"INFO"}, self.finish(context, result))
        except ReshadeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    def _tell(self, context: bpy.types.Context, step: Progress) -> None:
        state = context.window_manager.reshade
        state.fraction, state.message = step.fraction, step.message
        context.workspace.status_text_set(f"{step.message}: {100 * step.fraction:.0f} %     Esc: cancel")
        _redraw(context)

    def _close(self, context: bpy.types.Context) -> None:
        if self._steps is not None:
            self._steps.close()
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
        self._steps = self._timer = None
        state = context.window_manager.reshade
        state.running, state.fraction, state.message = "", 0.0, ""
        context.workspace.status_text_set(None)
        _redraw(context)


def _redraw(context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("VIEW_3D", "IMAGE_EDITOR"):  # where progress is shown
                area.tag_redraw()
