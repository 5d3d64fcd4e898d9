"""Report: what a run did, how long each stage took, and what became of the light."""

import json
import time
from contextlib import contextmanager

from .files import atomic_path


class Report:
    """Facts and stage times of a run, gathered as it goes.

    Attributes
    ----------
    facts : dict
        Anything that JSON can hold.
    stages : dict of str: float
        Seconds spent in each stage, without the stages inside it.
    """

    def __init__(self):
        self.facts = {}
        self.stages = {}
        self._started = []

    @contextmanager
    def stage(self, name):
        """Time a stage. Stages may be inside one another and may come again."""
        self._started.append(0.0)
        begin = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - begin
            inside = self._started.pop()
            if self._started:
                self._started[-1] += elapsed
            self.stages[name] = self.stages.get(name, 0.0) + elapsed - inside

    def as_dict(self):
        return {"stages_s": dict(self.stages), "total_s": sum(self.stages.values())} | self.facts

    def write(self, path):
        """Write the report as JSON, whole or not at all."""
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(self.as_dict(), indent=2) + "\n", encoding="utf-8")
