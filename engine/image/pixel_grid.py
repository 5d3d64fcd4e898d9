"""The pixel grid of the work: the capture, and the picture made of it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Grid:
    """The pixels of a capture and those of the picture made of it, which is the sensor's frame with a margin.

    Sizes are (rows, columns); `centre_px` is where the axis meets the picture, in its index terms.
    """

    capture_px: tuple[int, int]
    capture_centre_px: tuple[float, float]
    picture_px: tuple[int, int]
    centre_px: tuple[float, float]
    pitch_um: float
    projection: str


def lay_out(radiance, psf_radius_px):
    """The pixel grid of the work, and where the frame lies in its canvas.

    Light from just outside the frame is blurred into it: the frame is filtered with a margin of one PSF radius, as
    far as the capture reaches.
    """
    margin = [min(overscan, psf_radius_px) for overscan in radiance.overscan_px]
    cut = [overscan - m for overscan, m in zip(radiance.overscan_px, margin)]
    grid = Grid(capture_px=radiance.cube.shape[1:], capture_centre_px=radiance.centre_px,
                picture_px=tuple(n + 2 * m for n, m in zip(radiance.frame_px, margin)),
                centre_px=tuple(centre - c for centre, c in zip(radiance.centre_px, cut)),
                pitch_um=radiance.pitch_um, projection=radiance.projection)
    frame = tuple(slice(m + psf_radius_px, m + psf_radius_px + n) for m, n in zip(margin, radiance.frame_px))
    return grid, frame
