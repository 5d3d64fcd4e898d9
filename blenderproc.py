"""BlenderProc's pictures through a lens, for scripts that `blenderproc run` executes:

    import blenderproc as bproc
    from lensfield import Rings
    from lensfield.blenderproc import set_lens_distortion

    bproc.init()
    bproc.camera.set_resolution(640, 480)
    mapping_coords = set_lens_distortion("nikkor-28mm", Rings(focus_mm=2000, f_number=8))
    data = bproc.renderer.render()
    data["colors"] = bproc.postprocessing.apply_lens_distortion(data["colors"], mapping_coords, 640, 480)

`set_lens_distortion` takes the place of `bproc.camera.set_lens_distortion(k1, k2, ...)`, with the rays of a lens
instead of coefficients. docs/blenderproc.md describes both ways to take BlenderProc's scenes through a lens.
"""

import blenderproc as bproc
import bpy
import numpy as np

from lensfield.engine import InputError, load_lens
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.stmap import pinhole_px
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.library import clamped_rings, fits_all_frames, has_rings, pinhole_of
from lensfield.engine.rays.rings import AT_REST

BORDER_PX = 1
"""Around the places of the map, for the splines of `apply_lens_distortion`."""
MOST_PX = 16384
"""Of a side of the pinhole picture."""


def set_lens_distortion(lens, rings=AT_REST, wavelength_nm=None, quality="standard"):
    """Set the camera to the pinhole picture that a lens distorts, and return the distortion.

    The frame has the resolution that is set before, and fits on the lens's own sensor. The principal point stays: the
    optical axis is there. The camera then has the lens's focal length, and a resolution with all pixels that the lens
    shows, as after `bproc.camera.set_lens_distortion`.

    Parameters
    ----------
    lens : str, path or Prescription
        As for `load_lens`.
    rings : Rings
        Focus distance and f-number, on which distortion depends slightly.
    wavelength_nm : float, optional
        By default, the lens's reference wavelength.
    quality : str
        As for `load_lens`.

    Returns
    -------
    array (2, row * column)
        `mapping_coords` for `bproc.postprocessing.apply_lens_distortion`: the rows and columns in the pinhole picture
        of the pixels of the frame.

    Raises
    ------
    InputError
        The lens or its settings are wrong, or a side of the pinhole picture would exceed MOST_PX.
    """
    render = bpy.context.scene.render
    frame_px = render.resolution_y, render.resolution_x
    column, row = bproc.camera.get_intrinsics_as_K_matrix()[:2, 2]

    def frame_of(pinhole):
        return PixelGrid(frame_px, fitting_pitch_um(pinhole, frame_px), centre_px=(row, column))

    edges_mm = None if fits_all_frames(lens, rings) else frame_of(pinhole_of(lens, rings)).edges_mm
    loaded = load_lens(lens, rings, quality, edges_mm=edges_mm)
    for line in clamped_rings(lens, rings) if has_rings(lens) else ():
        print(f"lens: {line}")
    return _set_pinhole(loaded, frame_of(loaded), reference_nm(loaded) if wavelength_nm is None else wavelength_nm)


def _set_pinhole(lens, frame, wavelength_nm):
    """Set the camera's intrinsics and resolution for the map of a frame; returns the map."""
    places_px = np.stack(pinhole_px(lens, frame, wavelength_nm))
    first = np.floor(places_px.min(axis=(1, 2))) - BORDER_PX
    rows, columns = (np.ceil(places_px.max(axis=(1, 2))) + BORDER_PX - first).astype(int) + 1
    if max(rows, columns) > MOST_PX:
        raise InputError(lens.name, "pinhole picture", f"of {columns} x {rows} px",
                         f"expected at most {MOST_PX} on a side: use a lower resolution, or lensfield render")
    covered = field_map(lens).at_wavelength(wavelength_nm).within(*frame.position_mm(*np.indices(frame.shape_px)))
    if not covered.all():
        print(f"lens: its data cover {covered.mean():.2%} of the frame; the map continues beyond them")
    focal_px = lens.capture_focal_length_mm / (frame.pitch_um * 1e-3)
    row, column = frame.centre_px - first
    matrix = [[focal_px / lens.squeeze, 0, column], [0, focal_px, row], [0, 0, 1]]
    bproc.camera.set_intrinsics_from_K_matrix(matrix, int(columns), int(rows))
    return (places_px - first[:, None, None]).reshape(2, -1)
