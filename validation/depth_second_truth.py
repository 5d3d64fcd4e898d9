"""Depth against an independent reference: lenses that Optiland reads, focuses and traces itself.

    python validation/depth_second_truth.py [FOLDER]

in the environment of `make test-bake`, with a FOLDER of prescriptions (by default ../shared/data/prescriptions). Small
square lamps, near and far, on and off the axis, fully visible or half hidden behind a nearer edge, are imaged by
`simulate` in layers of depth, and by Optiland's rays. The scene does not depend on Lensfield's lens: its pinhole is in
the entrance pupil that Optiland computes, with a focal length chosen here. Each line is a lamp: the error of its disc's
centroid, in pixels; the differences of its RMS radius, along the field and across, and of its light; and the same for
`psf_at_depth`, whose position is the chief ray's. The exit status is 1 if a figure exceeds its limit.
"""

import re
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from foreign_lens import ForeignLens
from lensfield.engine import Options, Rings, load_lens, simulate
from lensfield.engine.bake.through_focus import psf_at_depth
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.library.rays import lens_rays

PRESCRIPTIONS = Path(__file__).resolve().parents[2] / "shared" / "data" / "prescriptions"
NM, TRANSMITTANCE, RADIANCE = 550.0, 0.83, 7.0
DISC_PX, LAMP_PX = 36.0, 3  # across
FRAME_PX, MARGIN_PX = (97, 118), (67, 61)
OFF_MIDDLE_PX = 6, -9  # of the disc in the frame
PINHOLE = 1.01  # focal length of the capture, over Optiland's
POINT = 1e-7  # half the side of a lamp that represents a point, over its depth
WAY = np.array([np.cos(np.radians(37)), np.sin(np.radians(37))])  # from the axis, along neither a side nor a diagonal
ACROSS = np.array([-WAY[1], WAY[0]])
EDGE = 0.25  # of the pupil's radius: distance from its middle at which an edge cuts the bundle
MOST_OFF_PX, MOST_RADIUS, MOST_LIGHT = 0.1, 0.01, 0.01
DIFFRACTION = 0.35  # times wavelength and f-number over the RMS radius: limit for a PSF's wings, which rays lack
PSF_SAMPLES, PSF_WINDOW = 101, 12.0  # in RMS radii: in a narrower one diffraction shifts light out of it



@dataclass(frozen=True)
class Case:
    """A prescription and the positions of its lamps.

    Attributes
    ----------
    file : str
    depths_mm : tuple of float
        From the entrance pupil.
    tangents : tuple of float
        Tangents of the angles from the axis.
    focus_mm : float or None
        None for the image plane of the file.
    stop_mm : float or None
        Semi-diameter of the stop, if the program that wrote the file states it and Optiland reads another.
    glasses : tuple of (str, str)
        Names in the file, and the catalogue names that replace them for both readers.
    """

    file: str
    depths_mm: tuple
    tangents: tuple
    focus_mm: float | None = None
    stop_mm: float | None = None
    glasses: tuple = ()


CASES = (
    Case("Tessar_vignetting.ZMX", (1200.0, 4000.0), (0.0, 0.2, 0.4), glasses=(("KF9", "N-KF9"),)),
    Case("Cooke_40_degree_field.zmx", (700.0, 6000.0), (0.0, 0.18, 0.32), focus_mm=1500.0),
    Case("EO54852.ZMX", (90.0, 1500.0), (0.0, 0.2, 0.4), stop_mm=1.572530251, glasses=(  # f/1.8 by paraxial working
        ("RXGLASS", "CDGM"), ("LAK10C", "H-LAK10"), ("LAF1C", "H-LAF1"), ("ZF7C", "ZF7"), ("ZK9C", "H-ZK9A"),
        ("LAK1C", "H-LAK1"))),
    Case("rayoptics_ag_dblgauss.seq", (2500.0, 9000.0), (0.0, 0.1, 0.2)))


@dataclass(frozen=True)
class Apart:
    """Differences of Lensfield's Disc from Optiland's: centroids in pixels, and relative differences.

    `light` is None for a PSF, because it is normalised. `oval` is the ratio of Optiland's radii along and across the
    field. `wings` is the part of the radii that diffraction may add.
    """

    px: float
    along: float
    across: float
    light: float | None
    oval: float
    wings: float = 0.0

    @property
    def missed(self):
        worst = max(abs(self.along), abs(self.across))
        return bool(self.px > MOST_OFF_PX or worst > MOST_RADIUS + self.wings or abs(self.light or 0.0) > MOST_LIGHT)

    def __str__(self):
        light = "" if self.light is None else f", light {self.light:+.2%}"
        return (f"{self.px:.3f} px, radius along {self.along:+.2%}, across {self.across:+.2%}{light}"
                f" (oval {self.oval:.2f}){'  MISSED' * self.missed}")


def apart(ours, true, pitch_mm, light=True):
    """The Apart of two Discs."""
    return Apart(float(np.hypot(*(ours.centroid_mm - true.centroid_mm))) / pitch_mm, ours.along_mm / true.along_mm - 1,
                 ours.across_mm / true.across_mm - 1, ours.light / true.light - 1 if light else None,
                 true.along_mm / true.across_mm)


@dataclass(frozen=True)
class Disc:
    """A disc of light: its centroid in mm, RMS radii along and across the field in mm, and light in W/nm."""

    centroid_mm: np.ndarray
    along_mm: float
    across_mm: float
    light: float


def disc_of(x_mm, y_mm, light):
    """The Disc of weighted points."""
    centroid = np.array([np.average(x_mm, weights=light), np.average(y_mm, weights=light)])
    spread = [np.sqrt(np.average(((x_mm - centroid[0]) * a + (y_mm - centroid[1]) * b)**2, weights=light))
              for a, b in (WAY, ACROSS)]
    return Disc(centroid, *spread, float(np.sum(light)))


class Judged:
    """A lens in both programs, from one file."""

    def __init__(self, path, focus_mm=None, stop_mm=None):
        self.foreign = ForeignLens(path, NM, focus_mm, stop_mm)
        self.lens = dimmed(load_lens(path, Rings(focus_mm), quality="preview"))  # only rays count out of focus

    def lamp(self, depth_mm, tangent, hidden=False):
        """The Apart of a lamp."""
        lamp = Lamp(self.foreign, depth_mm, tangent, hidden)
        shown = simulate(lamp.layered(), self.lens, Options(accuracy=0.001))
        x_mm, y_mm = np.meshgrid(*shown.grid.axes_mm())
        ours = disc_of(x_mm.ravel(), y_mm.ravel(), shown.cube[0].ravel() * lamp.pitch_mm**2)
        return apart(ours, lamp.traced(), lamp.pitch_mm)

    def psf(self, depth_mm, tangent):
        """The Apart of the PSF of a point, positioned relative to the chief ray."""
        place_mm = tangent * depth_mm * WAY
        chief_mm = self.foreign.chief_mm(place_mm, depth_mm)
        landed_mm, light = self.foreign.lamp(place_mm, POINT * depth_mm, depth_mm)
        from_chief_mm = landed_mm - chief_mm[:, None]
        all_of_it = disc_of(*from_chief_mm, light)
        pitch_mm = PSF_WINDOW * max(all_of_it.along_mm, all_of_it.across_mm) / PSF_SAMPLES
        within = np.all(np.abs([WAY @ from_chief_mm, ACROSS @ from_chief_mm]) < PSF_SAMPLES / 2 * pitch_mm, axis=0)
        true = disc_of(*from_chief_mm[:, within], light[within] / light[within].sum())
        psf = psf_at_depth(lens_rays(self.lens), NM, float(np.hypot(*chief_mm)), depth_mm, 1e3 * pitch_mm, PSF_SAMPLES)
        v, u = (np.indices(psf.shape) - PSF_SAMPLES // 2) * pitch_mm
        x_mm, y_mm = (v * along + u * across for along, across in zip(WAY, ACROSS, strict=True))
        difference = apart(disc_of(x_mm.ravel(), y_mm.ravel(), psf.ravel()), true, pitch_mm, light=False)
        f_number = self.foreign.efl_mm / (2 * self.foreign.entrance_pupil_radius_mm)
        return replace(difference, wings=DIFFRACTION * 1e-6 * NM * f_number / min(true.along_mm, true.across_mm))


def dimmed(lens):
    """The lens with the same transmittance at every wavelength."""
    return replace(lens, transmittance=np.full_like(lens.transmittance, TRANSMITTANCE))


class Lamp:
    """A lamp LAMP_PX pixels wide and high, out of focus: the capture by a pinhole, and the disc by Optiland's rays.

    The pixel pitch makes the disc DISC_PX wide, and off the axis the frame does not contain the axis; `hidden` puts an
    upright edge in front of the lamp.
    """

    def __init__(self, foreign, depth_mm, tangent, hidden):
        self._foreign, self._depth_mm = foreign, depth_mm
        place_mm = tangent * depth_mm * WAY
        (x_mm, y_mm), light = foreign.lamp(place_mm, POINT * depth_mm, depth_mm, rays=2**12)
        disc = disc_of(x_mm, y_mm, light)
        self.pitch_mm = 4 * max(disc.along_mm, disc.across_mm) / DISC_PX
        self._pinhole_mm = PINHOLE * foreign.efl_mm
        self._pixel = self.pitch_mm / self._pinhole_mm * np.array([foreign.squeeze, 1.0])  # as tangents
        pupil_mm = foreign.entrance_pupil_radius_mm
        disc_pixel = DISC_PX * self._pixel[0]
        self._near_mm = 1 / (1 / depth_mm + disc_pixel / (2 * pupil_mm))  # a pixel there is one of the disc
        self._middle_px = np.round(tangent * WAY / self._pixel)  # from the axis, to the right and up
        right, up = np.round(disc.centroid_mm / self.pitch_mm)
        rows, columns = np.array(FRAME_PX) + 2 * np.array(MARGIN_PX)
        centre_px = rows // 2 + OFF_MIDDLE_PX[0] + up, columns // 2 + OFF_MIDDLE_PX[1] - right
        self._grid = PixelGrid((rows, columns), 1e3 * self.pitch_mm, centre_px, MARGIN_PX, squeeze=foreign.squeeze)
        middle_mm = self._middle_px[0] * self._pixel[0] * self._near_mm
        cut_mm = EDGE * pupil_mm * (1 - self._near_mm / depth_mm)
        self._edge_px = np.floor((middle_mm + cut_mm) / (self._pixel[0] * self._near_mm)) + 0.5 if hidden else None

    def layered(self):
        """The LayeredRadiance of the pinhole."""
        rows, columns = np.indices(self._grid.shape_px)
        right, up = columns - self._grid.centre_px[1], self._grid.centre_px[0] - rows
        lit = (abs(right - self._middle_px[0]) < LAMP_PX / 2) & (abs(up - self._middle_px[1]) < LAMP_PX / 2)
        if np.count_nonzero(lit) != LAMP_PX**2:
            raise ValueError("the lamp is not in the capture: raise MARGIN_PX")
        layers = [Layer(RADIANCE * lit[None], np.ones(lit.shape), np.full(lit.shape, self._depth_mm))]
        if self._edge_px is not None:
            layers.insert(0, Layer(np.zeros((1, *lit.shape)), right > self._edge_px, np.full(lit.shape, self._near_mm)))
        return LayeredRadiance(tuple(layers), [NM], self._grid, self._pinhole_mm)

    def traced(self):
        """The Disc by Optiland's rays."""
        blocked, step_mm = None, self._pixel * self._depth_mm
        if self._edge_px is not None:
            def blocked(place_at):
                return place_at(self._near_mm)[0] > self._edge_px * self._pixel[0] * self._near_mm
        (x_mm, y_mm), light = self._foreign.lamp(self._middle_px * step_mm, LAMP_PX / 2 * step_mm, self._depth_mm,
                                                 blocked)
        return disc_of(x_mm, y_mm, light * RADIANCE * TRANSMITTANCE)


def with_glasses(path, glasses, folder):
    """A copy of a prescription with other names of glasses."""
    text = path.read_text(encoding="latin-1")
    for name, other in glasses:
        text, count = re.subn(rf"\b{re.escape(name)}\b", other, text)
        if not count:
            raise ValueError(f"{path} does not contain the glass {name}")
    copy = Path(folder) / path.name
    copy.write_text(text, encoding="latin-1")
    return copy


def figures(case, judged):
    """(label, Apart) of each lamp and PSF of a Case."""
    for depth_mm in case.depths_mm:
        for tangent in case.tangents:
            where = f"{depth_mm:g} mm, tangent {tangent:g}"
            yield f"{where}: lamp", judged.lamp(depth_mm, tangent)
            yield f"{where}: lamp behind an edge", judged.lamp(depth_mm, tangent, hidden=True)
            yield f"{where}: PSF", judged.psf(depth_mm, tangent)


def main(folder=PRESCRIPTIONS):
    """Check each case, and return the number of lamps and PSFs beyond a limit."""
    count = 0
    for case in CASES:
        with tempfile.TemporaryDirectory() as copies:
            judged = Judged(with_glasses(Path(folder) / case.file, case.glasses, copies), case.focus_mm, case.stop_mm)
        lens, foreign = judged.lens, judged.foreign
        print(f"\n{case.file}: focal length {lens.efl_mm:.5f} mm, Optiland {foreign.efl_mm:.5f} mm; entrance pupil at "
              f"{lens.entrance_pupil_mm:.5f} mm, Optiland {foreign.entrance_pupil_mm:.5f} mm", flush=True)
        for label, apart in figures(case, judged):
            count += apart.missed
            print(f"{label:>48}: {apart}", flush=True)
    return count


if __name__ == "__main__":
    sys.exit(1 if main(*sys.argv[1:2]) else 0)
