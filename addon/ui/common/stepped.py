"""Operators whose work is a generator of steps: a script waits for it; in a window it shows its progress, and Esc
cancels it."""

import bpy

from lensfield.engine.runtime.errors import InputError, one_line

STEP_S = 0.01


class Stepped:
    """Base of operators with `steps(context)`, a generator that does the work and yields the finished fraction."""

    meanwhile = {"PASS_THROUGH"}
    """What becomes of other events: passed on, or, with RUNNING_MODAL, not, so that nothing changes meanwhile."""

    def execute(self, context):
        self._steps = self.steps(context)
        context.window_manager.progress_begin(0, 1)
        if bpy.app.background:
            while (result := self._step(context)) == {"RUNNING_MODAL"}:
                pass
            return result
        self._timer = context.window_manager.event_timer_add(STEP_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set(f"{self.bl_label}  \u00b7  Esc: cancel")
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            return self._end(context, {"CANCELLED"})
        return self._step(context) if event.type == "TIMER" else self.meanwhile

    def _step(self, context):
        try:
            context.window_manager.progress_update(next(self._steps))
            return {"RUNNING_MODAL"}
        except StopIteration:
            return self._end(context, {"FINISHED"})
        except (InputError, OSError, RuntimeError) as error:
            self.report({"ERROR"}, one_line(error))
            return self._end(context, {"CANCELLED"})

    def _end(self, context, result):
        context.window_manager.progress_end()
        if not bpy.app.background:
            context.window_manager.event_timer_remove(self._timer)
            context.workspace.status_text_set(None)
        return result
