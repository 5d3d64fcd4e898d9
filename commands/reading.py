"""Input of `lensfield filter`: spectral radiance, or any renderer's RGB or deep picture, with the depth in the file."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lensfield.engine import ImageError, SpectralImage
from lensfield.engine.depth.depth_range import OFF
from lensfield.engine.depth.slabs import SlabPlan
from lensfield.engine.image.layers import LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sources import Sources
from lensfield.engine.lens.pinhole import field_of_view_deg, fitting_pitch_um, fov_pitch_um
from lensfield.engine.simulation.file_depth import FileDepth, deep_in_mm, file_depth, layers_of_deep, layers_of_flat
from lensfield.engine.simulation.report_parts import Upsampling
from lensfield.engine.spectral.spectra import parse_wavelengths
from lensfield.engine.spectral.wavelength_choice import RGB_WAVELENGTHS

from .arguments import MM, number_pair

RGB_ONLY = ("wavelengths", "layer", "fov", "focal_mm", "sensor_width_mm", "shift")


@dataclass(frozen=True, eq=False)
class PictureAsRead:
    """A picture that was read.

    Attributes
    ----------
    radiance : SpectralImage
    picture : Upsampling, optional
        How an RGB picture was interpreted; None for spectral radiance.
    channel : str
        The depth channel.
    depth : FileDepth, optional
        None if the file lacks depth or if depth is off.
    layers : callable (SlabPlan), optional
        Splits it into layers by its depth.
    guessed : str
        The guessed part of the layers; "" if all of them were captured.
    outside : Sources, optional
        The sources of stray light beyond the picture's edges; None if the file does not state them.
    """

    radiance: SpectralImage
    picture: Upsampling | None = None
    channel: str = ""
    depth: FileDepth | None = None
    layers: Callable[[SlabPlan], LayeredRadiance] | None = None
    guessed: str = ""
    outside: Sources | None = None


def read_picture(path, options, lens):
    """Read a file, as the command line's options interpret it.

    Returns
    -------
    PictureAsRead
    """
    from lensfield.engine.pictures.deep_exr import read_deep_exr
    from lensfield.engine.pictures.rgb_picture import rgb_of
    from lensfield.engine.pictures.spectral_exr import is_spectral, read_parts

    if is_spectral(path):
        return _spectral(path, options, lens)
    deep = read_deep_exr(path, options.layer)
    if deep is not None:
        return _deep(deep, options, lens)
    parts = read_parts(path)
    picture = rgb_of(parts, path, options.layer)
    source = PictureAsRead(*_upsampled(picture, options, lens))
    return _with_depth(source, parts, options, lens, picture) if options.depth != OFF else source


def frame_of(path, options, lens):
    """The frame of a file's picture on the sensor of a lens, or of its Pinhole, from the headers alone: a PixelGrid."""
    from lensfield.engine.pictures.spectral_exr import is_spectral, read_header, read_parts

    if is_spectral(path):
        return read_header(path, options.pitch_um)[0].grid.frame()
    (left, top), (right, bottom) = read_parts(path, header_only=True)[0][0]["displayWindow"]
    frame_px = int(bottom - top + 1), int(right - left + 1)
    return _shifted(PixelGrid(frame_px, _pitch_um(options, lens, frame_px)), options)


def _spectral(path, options, lens):
    from lensfield.engine.pictures.spectral_exr import read_sources, read_with_layers, read_with_planes

    for name in RGB_ONLY:
        if (value := getattr(options, name)) is not None:
            raise ImageError(path, f"--{name.replace('_', '-')}", value,
                             "leave it out: it applies to RGB files, and this file is spectral")
    outside = read_sources(path)
    if options.depth == OFF:
        return PictureAsRead(read_with_planes(path, options.pitch_um, options.output.parent)[0], outside=outside)
    radiance, planes, layered = read_with_layers(path, options.pitch_um, options.output.parent)
    source = _with_depth(PictureAsRead(radiance, outside=outside), [({}, planes)], options, lens)
    return replace(source, layers=lambda plan: layered, guessed="") if layered and source.depth else source


def _with_depth(source, parts, options, lens, picture=None):
    """The picture with the depth in its file, if any."""
    from lensfield.engine.pictures.depth_channel import depth_channel
    from lensfield.engine.pictures.rgb_picture import lay_out

    match = depth_channel(parts, picture.layer if picture else "", options.depth_channel)
    if match is None:
        return source
    channel, header, plane = match
    if picture:
        plane = lay_out(plane, parts[0][0] | header, picture.overscan_px, empty=np.inf)
    depth = file_depth(plane, lens, source.radiance.grid, MM[options.depth_unit], options.depth_is)
    return replace(source, channel=channel, depth=depth, guessed="surfaces hidden by near objects",
                   layers=lambda plan: layers_of_flat(source.radiance, depth, plan))


def _deep(deep, options, lens):
    flat, = deep.slabs(np.zeros(deep.pixel.size, int), 1)
    radiance, facts = _upsampled(flat[0], options, lens)
    if options.depth == OFF:
        return PictureAsRead(radiance, facts)
    deep = deep_in_mm(deep, lens, radiance.grid, MM[options.depth_unit], options.depth_is)
    planar_mm = deep.first_depth()

    def light(picture):
        return _upsampled(picture, options, lens)[0]

    return PictureAsRead(radiance, facts, f"{deep.layer}.Z".lstrip("."), FileDepth(planar_mm, planar_mm, 0.0),
                lambda plan: layers_of_deep(radiance, deep, plan, light),
                "hidden surfaces that the file lacks")


def _upsampled(picture, options, lens):
    """The radiance of a picture in RGB, and how the picture was interpreted."""
    from lensfield.engine.pictures.rgb_picture import upsample

    pitch_um = _pitch_um(options, lens, picture.frame_px)
    wavelengths_nm = parse_wavelengths(options.wavelengths or RGB_WAVELENGTHS)
    radiance, negative = upsample(picture, wavelengths_nm, pitch_um, options.output.parent)
    radiance = replace(radiance, grid=_shifted(radiance.grid, options))
    across, down = (field_of_view_deg(lens.capture_focal_length_mm, n * pitch_um * 1e-3)
                    for n in picture.frame_px[::-1])
    return radiance, Upsampling(picture.layer or "RGB", (across, down), wavelengths_nm.tolist(), negative)


def _shifted(grid, options):
    """The grid, moved by the option --shift."""
    if options.shift is None:
        return grid
    return grid.shifted(*(part_mm / (grid.pitch_um * 1e-3) for part_mm in number_pair(options.shift, "--shift")))


def _pitch_um(options, lens, frame_px):
    """The pixel pitch of an RGB picture on the sensor, from the camera that rendered it."""
    if options.pitch_um is not None:
        return options.pitch_um
    fov_deg = options.fov
    if options.focal_mm is not None:
        fov_deg = field_of_view_deg(options.focal_mm, options.sensor_width_mm)
    return fitting_pitch_um(lens, frame_px) if fov_deg is None else fov_pitch_um(lens, frame_px[1], fov_deg)
