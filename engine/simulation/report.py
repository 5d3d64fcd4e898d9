"""Report: the facts of a run, the time of each stage, and the energy of the light."""

import json
import re
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..runtime.build_identity import build_identity, software
from ..runtime.files import atomic_path
from ..runtime.values import json_value
from .report_parts import FileFacts, LensImageFacts, Part, Parts, SceneFacts

FORMAT, VERSION = "lensfield-report", 1
FIGURE = re.compile(r"\d[\d.]*")


def together(reports: dict[int, "Report"], earlier: dict[int, dict] | None = None) -> "Report":
    """Combine reports of frames to one of their sequence: total seconds, each frame's report, and earlier reports."""
    stages: Counter[str] = Counter()
    for report in reports.values():
        stages.update(report.stages)
    return Report(dict(stages), frames=dict(reports), earlier=earlier or {})


@dataclass
class Report:
    """The facts of a run, collected while it proceeds.

    Attributes
    ----------
    stages : dict of str: float
        Seconds of each stage, without the stages inside it.
    parts : Parts
        Facts about the scene or the file, about the lens image, and so on.
    files : dict of str: str
        Paths of the files written, by kind.
    left_out : list of str
        Kinds of spectral files that the request left out.
    frames : dict of int: Report
        For a sequence, the reports by frame number; the sequence has no other facts.
    earlier : dict of int: dict
        For a sequence, the reports of frames that an earlier run rendered, as read from JSON.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Options, Report, SpectralImage, load_lens, simulate
    >>> radiance = SpectralImage(np.ones((24, 32)), wavelengths_nm=[550], pitch_um=15)
    >>> report = Report()
    >>> irradiance = simulate(radiance, load_lens("edmund-54852"), Options(accuracy=0.1), report=report)
    >>> sorted(report.stages)
    ['casting', 'distortion and relative illumination', 'filtering', 'lens data', 'plan']
    >>> report.lens_image.frame_px
    (24, 32)
    """

    stages: dict[str, float] = field(default_factory=dict)
    parts: Parts = field(default_factory=Parts)
    files: dict[str, str] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    frames: dict[int, "Report"] = field(default_factory=dict)
    earlier: dict[int, dict] = field(default_factory=dict)
    _started: list[float] = field(default_factory=list, repr=False)

    @property
    def lens_image(self) -> LensImageFacts | None:
        """Facts from `simulate`."""
        return self.parts.of(LensImageFacts)

    @property
    def scene(self) -> SceneFacts | None:
        """Facts about the scene, if the light is from one."""
        return self.parts.of(SceneFacts)

    @property
    def file(self) -> FileFacts | None:
        """Facts about the file, if the light is from one."""
        return self.parts.of(FileFacts)

    def add(self, part: Part) -> None:
        """Add a part; it replaces an existing part of its type."""
        self.parts.put(part)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time a stage. Stages may be nested and repeated."""
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

    def remarks(self) -> list[str]:
        """Remarks for the user, one line each. Remarks of frames that differ only in their figures are combined."""
        alike: dict[str, list[tuple[int, str]]] = {}
        for number, report in self.frames.items():
            for line in report._common_remarks():
                alike.setdefault(FIGURE.sub("", line), []).append((number, line))
        return [*self._common_remarks(), *(self._remark_of_frames(lines) for lines in alike.values()),
                *self._unlike("casting", "cast"), *self._unlike("spreading", "filtered")]

    def _remark_of_frames(self, lines):
        (number, first), *others = lines
        if len(lines) == len(self.frames) and all(line == first for _, line in others):
            return first
        return f"frame {number}: {first}{f' ({len(others)} similar)' if others else ''}"

    def _unlike(self, field, done):
        """A line if not all frames had this done by the same device."""
        devices = [getattr(report.lens_image, field) for report in self.frames.values() if report.lens_image]
        devices += [report.get(field, "") for report in self.earlier.values()]
        frames = Counter(filter(None, devices))
        if len(frames) > 1:
            yield (f"frames were {done} by {', '.join(f'{name} ({count})' for name, count in frames.most_common())}: "
                   "they differ by rounding")

    def _common_remarks(self):
        for part in self.parts:
            yield from part.remarks(self.parts)

    def as_dict(self) -> dict:
        """The report as values for JSON."""
        facts: dict[str, Any] = {"build": build_identity(), "stages_s": dict(self.stages),
                                 "total_s": sum(self.stages.values())}
        for part in self.parts:
            facts |= part.as_dict()
        if self.files:
            facts["files"] = dict(self.files)
        if self.left_out:
            facts["left_out"] = list(self.left_out)
        frames = {number: {"frame": number} | report.as_dict() for number, report in self.frames.items()}
        frames |= {number: {"frame": number, "earlier": True} | report for number, report in self.earlier.items()}
        if frames:
            each = [frames[number] for number in sorted(frames)]
            facts |= {name: each[0][name] for name in ("lens", "plan") if name in each[0]}
            beyond = [frame["out_of_field_fraction"] for frame in each if "out_of_field_fraction" in frame]
            facts |= {"out_of_field_fraction": max(beyond)} if beyond else {}
            facts["frames"] = each
        return json_value(facts)

    def write(self, path: Path) -> None:
        """Write the report as JSON, atomically."""
        with atomic_path(path) as temporary:
            facts = {"format": FORMAT, "version": VERSION, "software": software()} | self.as_dict()
            temporary.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
