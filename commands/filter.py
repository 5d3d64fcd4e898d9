"""`lensfield filter`: apply a lens to spectral radiance or any renderer's RGB picture, single or in a sequence."""

import time
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path

import numpy as np

from lensfield.engine import ChannelCache, ImageError, InputError, Report
from lensfield.engine.depth.depth_range import AUTO, OFF
from lensfield.engine.depth.slabs import plan_slabs
from lensfield.engine.field.field_map import field_map
from lensfield.engine.lens.iris import opening
from lensfield.engine.pictures.frame_record import read_record, write_record
from lensfield.engine.runtime.build_identity import is_accepted, other_builds_line
from lensfield.engine.runtime.files import discard, stamp_of
from lensfield.engine.runtime.locks import Busy, only_writer
from lensfield.engine.runtime.values import json_value
from lensfield.engine.simulation.file_depth import DEPTH_KINDS
from lensfield.engine.simulation.lens_image import lens_image
from lensfield.engine.simulation.report import FIGURE, together
from lensfield.engine.simulation.report_parts import FileFacts
from lensfield.engine.spectral.wavelength_choice import RGB_WAVELENGTHS

from .arguments import (
    MM,
    add_engine_options,
    add_iris,
    add_lens_settings,
    add_stray,
    add_untrusted,
    check_outputs,
    chosen_lens,
    engine_options,
    number_pair,
    shown_iris,
    stray_option,
)
from .outcome import finish
from .reading import frame_of, read_picture
from .sequence import find_shots
from .terminal import progress_bar, quiet, say

WAIT_S = 0.5
OF_DEVICES = "casting", "spreading"  # of the report: what the frames' bits depend on
UNRECORDED = ("radiance", "output", "preview", "frames", "report", "overwrite", "any_build", "lens", "untrusted",
              "root", "time_limit", "memory_limit")
"""Options that finished frames do not depend on, or that their records state in other words."""
CAMERA_FIGURES = {"--pitch-um": ("pitch_um",), "--fov": ("fov",), "--focal-mm": ("focal_mm", "sensor_width_mm")}


def add_options(filter_):
    filter_.add_argument("radiance", type=Path, metavar="RADIANCE.exr",
                         help="picture to filter; in the name of a sequence, #### or %%04d is the frame number")
    filter_.add_argument("--frames", metavar="SPEC",
                         help="frames of a sequence: 7, 1-50, 1-50:2 or 1,5,10-20 (default: all existing frames)")
    filter_.add_argument("--overwrite", action="store_true",
                         help="filter all frames of a sequence again (default: skip complete frames with the same "
                              "pictures and settings)")
    filter_.add_argument("--any-build", action="store_true",
                         help="accept finished frames from other builds of Lensfield (default: filter them again)")
    filter_.add_argument("--output", type=Path, required=True, metavar="IRRADIANCE.exr",
                         help="irradiance to write; for a sequence, with #### or %%04d")
    filter_.add_argument("--preview", type=Path, metavar="FILE.png",
                         help="also write an sRGB picture; all frames of a sequence have the exposure of the first")
    filter_.add_argument("--pitch-um", type=float, help="pixel pitch at the sensor, for a file that does not state it")
    rgb = filter_.add_argument_group("RGB pictures", "upsampled as light; without camera figures, taken to cover "
                                                     "exactly the lens's field, as after Match Camera to Lens")
    rgb.add_argument("--wavelengths", metavar="SPEC", help="in nm: first:last:number, or a list such as 450,550,650 "
                                                           f"(default: {RGB_WAVELENGTHS})")
    rgb.add_argument("--layer", metavar="NAME", help="layer with the picture, such as ViewLayer.Combined")
    rgb.add_argument("--fov", type=float, metavar="DEGREES", help="horizontal field of view of the rendering camera")
    rgb.add_argument("--focal-mm", type=float, metavar="F", help="focal length of the camera; with --sensor-width-mm")
    rgb.add_argument("--sensor-width-mm", type=float, metavar="W", help="sensor width of the camera; with --focal-mm")
    rgb.add_argument("--shift", metavar="X,Y",
                     help="shift of the camera's sensor in mm on the lens's sensor, to the right and up in the "
                          "picture (default: 0,0)")
    depth = filter_.add_argument_group("depth", "for files with a depth channel, such as Z, or with deep samples: "
                                                "out-of-focus light is blurred, and hidden surfaces are guessed")
    depth.add_argument("--depth", choices=(AUTO, OFF), default=AUTO,
                       help="off: everything is as sharp as in focus (default: auto)")
    depth.add_argument("--depth-channel", metavar="NAME",
                       help="one of several depth channels, such as ViewLayer.Depth.Z")
    depth.add_argument("--depth-unit", choices=MM, default="m", help="unit of the depth values (default: m)")
    depth.add_argument("--depth-is", choices=DEPTH_KINDS, default="z",
                       help="z: depth along the camera's axis; distance: distance from the camera (default: z)")
    add_engine_options(filter_)
    add_lens_settings(filter_)
    add_iris(filter_)
    add_stray(filter_)
    add_untrusted(filter_)
    filter_.set_defaults(run=_filter, confines=_folders)


def _folders(options):
    """The picture and the output folder."""
    return options.radiance, options.output.parent


def _filter(options):
    chosen = engine_options(options)
    _check_view(options)
    shots = find_shots(options.radiance, options.output, options.preview, options.frames)
    lens = chosen_lens(options, lambda pinhole: _frame(shots[0], options, pinhole))
    check_outputs([*(target for shot in shots for target in ((shot.output, ".exr"), (shot.preview, ".png"))),
                   (options.report, ".json")], [options.lens, *(shot.radiance for shot in shots)])
    if shots[0].frame is None:
        report = _Run(options, lens, chosen, shots[0], 1).put_through(shots[0])
        say(*shots[0].targets)
    else:
        report = _filter_sequence(options, lens, chosen, shots)
    finish(options, report, [])


def _frame(shot, options, lens):
    """The frame of a picture on the sensor of a lens."""
    try:
        with quiet(1, 2):
            return frame_of(shot.radiance, options, lens)
    except ImageError as error:
        raise error.at(shot.radiance) from None


def _filter_sequence(options, lens, chosen, shots):
    """Filter the missing frames, except those that other processes are filtering; returns the report of all."""
    settings, first, reports = _recorded_settings(options, lens, chosen), shots[0], {}

    def job_of(shot):
        return settings | {"sources": shot.sources(first)}

    def record_of(shot):
        return read_record(shot.record, job_of(shot), shot.targets)

    def build_of(record):
        return record and record["build"]

    noted = {shot: stamp_of(shot.record) for shot in shots}  # before checking whether the frames are complete
    records = {} if options.overwrite else {shot: record_of(shot) for shot in shots}
    builds = {shot: build_of(record) for shot, record in records.items()}
    pending = [shot for shot in shots if not is_accepted(builds.get(shot), options.any_build)]
    for line in other_builds_line(builds.values(), options.any_build, "filtered"):
        say(line)
    if len(pending) < len(shots):
        say(f"{len(shots) - len(pending)} of {len(shots)} frames are finished: {len(pending)} to filter")
    run = _Run(options, lens, chosen, first, len(pending))

    def is_left(shot):
        try:
            with only_writer(shot.output):
                unchanged = stamp_of(shot.record) == noted[shot]
                if unchanged or not is_accepted(build_of(record_of(shot)), options.any_build):
                    discard(shot.record)
                    reports[shot.frame] = run.put_through(shot)
                    write_record(shot.record, job_of(shot), shot.targets,
                                 {name: getattr(reports[shot.frame].lens_image, name) for name in OF_DEVICES})
                    say(*shot.targets)
        except Busy:
            return True
        return False

    if options.preview and first in pending:  # the first frame sets the exposure of all previews
        while is_left(first):
            time.sleep(WAIT_S)
        pending.remove(first)
    # the second attempt takes over frames of processes that were stopped in the meantime
    left = [shot for shot in [shot for shot in pending if is_left(shot)] if is_left(shot)]
    if left:
        say(f"left to other processes: {len(left)} of the frames, from frame {left[0].frame} on")
    earlier = {shot.frame: records.get(shot) or {} for shot in shots if shot.frame not in reports}
    return together(reports, {frame: {name: record[name] for name in OF_DEVICES if name in record}
                              for frame, record in earlier.items()})


def _recorded_settings(options, lens, chosen):
    """Everything that the frames of a command line depend on, except their files, as JSON values."""
    arguments = {name: value if value is None else str(value) for name, value in vars(options).items()
                 if name not in UNRECORDED and not callable(value)}
    return json_value({"arguments": arguments, "options": asdict(chosen), "lens": lens.digest.hex()})


class _Run:
    """The state that the pictures of one command share: the lens, its cache, and the exposure."""

    def __init__(self, options, lens, chosen, first, number):
        self._options, self._lens, self._chosen, self._first, self._number = options, lens, chosen, first, number
        self._iris, self._stray = shown_iris(options), stray_option(options)
        self._cache = ChannelCache() if number > 1 else ChannelCache(limit_mb=0)
        self._exposure, self._reported, self._finished = None, set(), 0

    def put_through(self, shot):
        """Filter one picture, write the result, and return its report."""
        from lensfield.engine.pictures.spectral_exr import write_exr

        report = Report()
        try:
            with report.stage("read radiance"), quiet(1, 2):  # the EXR library prints long messages about damage
                source = read_picture(shot.radiance, self._options, self._lens)
            radiance, layers = source.radiance, None
            with report.stage("plan"):
                plan = self._cache.plan(self._chosen, self._lens, radiance)
                needed = field_map(self._lens).overscan_px(radiance.grid, radiance.wavelengths_nm, plan.reach_px)
                slabs = self._slabs(source, needed)
                self._report(source, plan, slabs)
            report.add(self._facts(shot, source, needed, slabs))
            if slabs and slabs.needed:
                with report.stage("layers of depth"):
                    layers = source.layers(slabs)
            irradiance, stray = self._through_lens(shot, radiance, layers, source.outside, report)
        except ImageError as error:
            raise error.at(shot.radiance) from None
        with report.stage("write irradiance"):
            write_exr(irradiance, shot.output, stray=stray)
        if shot.preview:
            with report.stage("write preview"):
                self._write_preview(irradiance, shot)
        self._finished += 1
        return report

    def _slabs(self, source, needed_px):
        """The plan of slabs from the depth in a file; None without depth."""
        return source.depth and plan_slabs(source.depth.planar_mm, source.radiance.grid, self._lens,
                                           overscan_px=needed_px, light=source.radiance.cube.mean(axis=0),
                                           reach=opening(self._iris, self._lens).reach,
                                           accuracy=self._chosen.depth_accuracy)

    def _facts(self, shot, source, needed_px, slabs):
        facts = FileFacts(str(shot.radiance), needed_px, source.picture)
        if slabs is None:
            return facts
        words = []
        if slabs.needed:
            words.append(f"depth from channel {source.channel}")
            if source.guessed:
                words.append(f"{source.guessed}, up to {slabs.behind:.2g} of the light, are guessed from their "
                             "surroundings")
            if self._lens.prescription is None:
                words.append("the lens data contain no rays: out-of-focus light is blurred by first-order circles")
            if source.depth.unknown:
                words.append(f"{source.depth.unknown:.1%} of the pixels have no depth and count as infinitely far")
        return replace(facts, depth=slabs.check, layers="; ".join(words))

    def _report(self, source, plan, slabs):
        """Print how a picture is interpreted, and its plan; in a sequence, only lines that differ from earlier ones."""
        lines = [f"plan: {plan.text}"]
        if source.picture:
            lines.insert(0, f"picture: {source.picture.layer}, upsampled to {len(source.picture.wavelengths_nm)} "
                            "wavelengths, {:.1f} x {:.1f} degrees".format(*source.picture.fov_deg))
        if slabs:
            lines.append(f"depth: {source.channel}: " + (
                f"{slabs.check.text}: {slabs.slabs_text if source.guessed else 'in the layers of the file'}"
                if slabs.needed else slabs.text))
        for line in lines:
            kind = FIGURE.sub("", line) if line.startswith("depth") else line  # with different figures in each frame
            if kind not in self._reported:
                say(line)
            self._reported.add(kind)

    def _through_lens(self, shot, radiance, layers, outside, report):
        label = f"Through {self._lens.name}" if shot.frame is None else f"Frame {shot.frame} through {self._lens.name}"
        with progress_bar() as on_progress:
            on_progress(self._finished / self._number, label)
            return lens_image(radiance, self._lens, self._chosen, self._stray, layers=layers, outside=outside,
                              iris=self._iris, report=report, cache=self._cache, progress=lambda fraction: on_progress(
                                  (self._finished + fraction) / self._number, label))

    def _write_preview(self, irradiance, shot):
        from lensfield.engine.pictures.preview import auto_exposure, to_rec709, write_png
        from lensfield.engine.pictures.spectral_exr import read_parts

        picture = to_rec709(irradiance)
        if self._exposure is None:
            first = picture
            if shot != self._first:  # it existed already, or another process has written it
                _, planes = read_parts(self._first.output)[0]
                first = np.stack([planes[channel] for channel in "RGB"], axis=-1)
            self._exposure = auto_exposure(np.ascontiguousarray(first, np.float32))
        write_png(picture, shot.preview, self._exposure)


def _check_view(options):
    """Raise an InputError for camera figures that are invalid or redundant."""
    for name, most in (("fov", 180), ("focal_mm", float("inf")), ("sensor_width_mm", float("inf"))):
        value = getattr(options, name)
        if value is not None and not (isfinite(value) and 0 < value < most):
            raise InputError("options", f"--{name.replace('_', '-')}", value,
                             "expected a positive number" + (" of degrees below 180" if name == "fov" else ""))
    if options.shift is not None:
        number_pair(options.shift, "--shift")
    given = [option for option, names in CAMERA_FIGURES.items()
             if any(getattr(options, name) is not None for name in names)]
    if len(given) > 1:
        raise InputError("options", given[1], f"combined with {given[0]}", "give only one of them")
    if (options.focal_mm is None) != (options.sensor_width_mm is None):
        missing = "--focal-mm" if options.focal_mm is None else "--sensor-width-mm"
        raise InputError("options", missing, "missing", "the field of view needs both focal length and sensor width")
