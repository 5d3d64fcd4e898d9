"""Checks of point spread functions: pitch, centring, symmetry, lost or wrapped light, and gaps between them."""

import numpy as np

from ..lens import RadialLens
from ..lens.symmetry import SYMMETRY_TOLERANCE
from .curves import airy_radius_um
from .finding import LensFinding, graded, greatest, place

LEAST_NM = 100  # below it the wavelengths are in another unit
PITCH_FACTOR = 100  # real tables have pitches of a few Airy radii at most; a wrong unit is a factor of 1000
FARTHEST_CENTROID = 1 / 6  # of the window, a third of the way to its border: real coma reaches half of that
LOPSIDED = 10 * SYMMETRY_TOLERANCE  # half a sample off centre is twice that
ENCLOSED_LIGHT = 0.995
TOO_LITTLE_LIGHT = 0.95
RING_LIGHT = 0.01  # measured with random aberrations: 5 to 10 % of the light is then beyond the window
BORDER_LIGHT = 0.005  # along one border, or two opposite borders: half of that
RISE = 1.2  # measured: at most 0.97 if nine tenths of the light are within the window
SEAM_LEAK = 1e-3
WRAPS = "it wraps round: sample the pupil more finely"
SMALLEST_WINDOW = 8  # in smaller windows, samples at the border do not indicate light beyond
SOFT, OUT_OF_FOCUS = 1 / 300, 1 / 150  # of the sensor's diagonal; the softest bundled lens, f/1.1, has 1 / 740
LINES = {"heights_mm": "heights", "y_mm": "rows", "x_mm": "columns"}  # of places in the field
GAP_NOTE, GAP_WARNING = 0.4, 1.0  # L1 distances: a fifth, and half, of the light is misplaced


def _pitch(lens):
    if lens.wavelengths_nm[0] < LEAST_NM:
        return
    pitch_um, shortest_nm = lens.psf_pitch_um, lens.wavelengths_nm[0]
    airy_um = airy_radius_um(lens, lens.wavelengths_nm.mean())
    nyquist_um = 0.5e-3 * shortest_nm * lens.rim_f_number  # the optical cutoff is 1 / (wavelength * f-number)
    if not 1 / PITCH_FACTOR < pitch_um / airy_um < PITCH_FACTOR:
        yield LensFinding("error", "psf_pitch_um", f"{pitch_um:g} um, where the Airy disc's radius is {airy_um:.3g} um",
                          "out of proportion: check the unit")
    elif pitch_um > nyquist_um:
        yield LensFinding("note", "psf_pitch_um", f"{pitch_um:g} um, where {nyquist_um:.3g} um resolves all detail "
                          f"at {shortest_nm:g} nm",
                          "finer detail is lost, which matters only for pixels this small")


def _centring(lens):
    v, u = _centroids(lens)
    distance, n = np.hypot(v, u), lens.psf.shape[-1]
    worst = greatest(distance)
    remedy = f"expected the chief ray at [{n // 2}, {n // 2}]: recentre the PSF, or widen its window"
    if distance[worst] > FARTHEST_CENTROID * n:
        along_v, along_u = _directions(lens)
        yield LensFinding("warning", "psf", f"centroid {v[worst]:.1f} samples {along_v} and {u[worst]:.1f} {along_u} "
                          f"{place(lens, *worst)}", remedy)
    inner = lens.psf[..., 1:-1, 1:-1].max(axis=(-2, -1), initial=0)
    excess = lens.psf.max(axis=(-2, -1)) - inner
    worst = greatest(excess)
    if excess[worst] > 0 and n >= 3:
        yield LensFinding("warning", "psf", f"brightest at its window's border {place(lens, *worst)}", remedy)


def _focus(lens):
    """Diameter of the disc with half the light, on the axis, where every lens should be sharp."""
    wave = int(np.abs(lens.wavelengths_nm - lens.reference_wavelength_nm).argmin())
    psf = lens.psf[wave, *lens.middle].astype(float)
    offset = np.arange(psf.shape[-1]) - psf.shape[-1] // 2
    distance = np.hypot(offset[:, None], offset).ravel()
    outwards = np.argsort(distance)
    inside = np.cumsum(psf.ravel()[outwards])
    disc_um = 2 * lens.psf_pitch_um * distance[outwards[np.searchsorted(inside, inside[-1] / 2)]]
    share = disc_um / (1e3 * np.hypot(*lens.sensor_mm))
    yield from graded(share, SOFT, OUT_OF_FOCUS, "psf", f"half the light in a disc of {disc_um:.3g} um, {share:.2%} of "
                      f"the sensor's diagonal, {place(lens, wave, *lens.middle)}",
                      "out of focus, or not a sharp lens: check the image plane, the object distance and psf_pitch_um")


def _mirror(lens):
    """Symmetry of PSFs on planes of symmetry, which sharing optics between halves or quadrants requires."""
    for part, axis, reason in _symmetric_parts(lens):
        distance = np.stack([_distance(psf, np.flip(psf, axis)) for psf in map(_odd, lens.psf[:, *part])])
        worst = greatest(distance)
        yield from graded(distance[worst], SYMMETRY_TOLERANCE, LOPSIDED, "psf",
                          f"{distance[worst]:.3g} in L1 from its mirror image in {'vu'[axis]}, centroid "
                          f"{_centroids(lens)[axis][worst]:.2f} samples {_directions(lens)[axis]}, "
                          f"{place(lens, *worst)}",
                          f"expected symmetry about [{lens.psf.shape[-1] // 2}], which an offset of half a sample "
                          f"destroys; {reason}")


def _symmetric_parts(lens):
    """Places whose PSFs should be their own mirror images, as slices from 0; the axis that is mirrored; and why."""
    if isinstance(lens, RadialLens):
        yield (slice(None),), -1, "filtering takes longer without it"
        return
    for number, axis in enumerate((-2, -1)):
        if lens.mirrored[number]:
            part = [slice(None), slice(None)]
            part[number] = slice(1)
            yield part, axis, f"the two halves of the field are mirror images about {lens.AXES[number][0]} = 0"


def _directions(lens):
    """The directions of +v and +u of PSFs."""
    return ("outwards", "sideways") if isinstance(lens, RadialLens) else ("upwards", "to the right")


def _axis_symmetry(lens):
    """Symmetries on the axis of a rotationally symmetric lens: those that a circle has on a square grid."""
    if not isinstance(lens, RadialLens):
        return
    unpaired = 1 - lens.psf.shape[-1] % 2
    axis = lens.psf[:, 0, unpaired:, unpaired:]
    distance = np.maximum(_distance(axis, axis[:, ::-1]), _distance(axis, axis.swapaxes(1, 2)))
    wave = distance.argmax()
    yield from graded(distance[wave], SYMMETRY_TOLERANCE, LOPSIDED, "psf",
                      f"{distance[wave]:.3g} in L1 from itself mirrored in v or turned by 90 degrees, centroid "
                      f"{_centroids(lens)[0][wave, 0]:.2f} samples outwards, {place(lens, wave, 0)}",
                      "a centred lens has round PSFs on its axis: check centring and equal pitch along v and u")


def _odd(psf):
    """PSFs with a partner for the row and the column at -n/2 of an even window."""
    even = 1 - psf.shape[-1] % 2
    return np.pad(psf, (*((0, 0),) * (psf.ndim - 2), (0, even), (0, even)))


def _distance(psf, other):
    return np.abs(psf - other).sum(axis=(-2, -1))


def _centroids(lens):
    """Centroids along v and u, in samples from the chief ray: two arrays (wavelength, *place)."""
    offset = np.arange(lens.psf.shape[-1]) - lens.psf.shape[-1] // 2
    return lens.psf.sum(axis=-1) @ offset, lens.psf.sum(axis=-2) @ offset


def _enclosed_energy(lens):
    energy, unknown = lens.enclosed_energy, np.isnan(lens.enclosed_energy)
    if unknown.any():
        yield LensFinding("note", "enclosed_energy", f"unknown for {unknown.sum()} of {unknown.size} PSFs",
                          "light lost beyond the window is unknown: give it if the source states it")
    impossible = np.argwhere(~unknown & ~((energy > 0) & (energy < 1.01)))
    if impossible.size:
        worst = tuple(impossible[0])
        yield LensFinding("error", "enclosed_energy", f"{energy[worst]:.4g} {place(lens, *worst)}",
                          "expected a fraction of the light, above 0 and up to 1")
        return
    lost = np.where(unknown, 0, 1 - energy)
    worst = greatest(lost)
    yield from graded(lost[worst], 1 - ENCLOSED_LIGHT, 1 - TOO_LITTLE_LIGHT, "enclosed_energy",
                      f"{energy[worst]:.4g} {place(lens, *worst)}",
                      "PSFs are normalised, which moves the rest into the window: widen it")


def _border(lens):
    """Unexplained light at the window's border: the PSF wraps round, or continues beyond.

    If the enclosed energy states the loss, only wrapping is reported.
    """
    if lens.psf.shape[-1] < SMALLEST_WINDOW:
        return
    unexplained = ~(lens.enclosed_energy < ENCLOSED_LIGHT)
    windows = [psf.reshape(-1, *psf.shape[-2:]) for psf in lens.psf]
    seamless = np.reshape(list(map(_seamless, windows)), lens.psf.shape[:-2])
    rise = np.reshape(list(map(_rise, windows)), lens.psf.shape[:-2])
    ring = np.reshape(list(map(_ring, windows)), lens.psf.shape[:-2])
    worst = greatest(seamless)
    if seamless[worst] > BORDER_LIGHT:
        yield LensFinding("warning", "psf", f"{seamless[worst]:.1%} of its light at two opposite borders, across which "
                          f"it continues without a seam, {place(lens, *worst)}",
                          f"{WRAPS}, for a period of two windows")
        return
    remedy = f"it continues beyond: widen the window, or state the loss in enclosed_energy; or {WRAPS}"
    rise, ring = rise * unexplained, ring * unexplained
    worst = greatest(rise)
    if rise[worst] > RISE:
        yield LensFinding("warning", "psf", f"{rise[worst]:.2f} times brighter at a border than next to it "
                          f"{place(lens, *worst)}", remedy)
        return
    worst = greatest(ring)
    if ring[worst] > RING_LIGHT:
        yield LensFinding("warning", "psf", f"{ring[worst]:.1%} of its light in the window's outermost samples "
                          f"{place(lens, *worst)}", remedy)


def _seamless(psf):
    """Light in two opposite border lines, if the PSF continues from one to the other like a periodic function.

    Like the next two, it is computed for each of PSFs (place, v, u).

    The intensity is band-limited. If the window was its period, it has no power at the grid's highest frequency, except
    for the lowest frequencies along the borders, where the support of a transfer function that the pitch only just
    resolves touches. Cropping causes a kink where the borders meet, with power at the highest frequency in proportion
    to the border lines' power. That ratio, measured with random aberrations at 1 to 3 times the resolving pitch:
    periodic < 1e-5 (median 1e-4 for files with five digits), cropped > 8e-3; cropped Gaussians > 2e-3.
    An odd window, which is never the size of a padded Fourier transform, is inconclusive: kinks between samples lack
    that power.
    """
    light = np.zeros(len(psf))
    if psf.shape[-1] % 2:
        return light
    alternating = (-1.0) ** np.arange(psf.shape[-1])
    for lines in (psf.astype(float), psf.swapaxes(1, 2).astype(float)):
        borders = np.abs(np.fft.fft(lines[:, [0, -1]])).sum(axis=1)[:, 2:-1]
        highest = np.abs(np.fft.fft(alternating @ lines))[:, 2:-1]
        at_border = lines[:, [0, -1]].sum(axis=(1, 2))
        leak, power = np.linalg.norm(highest, axis=1), np.linalg.norm(borders, axis=1)
        light = np.maximum(light, np.where((leak < SEAM_LEAK * power) & (power > 1e-3 * at_border), at_border, 0))
    return light


def _rise(psf):
    """The largest ratio of the light in a strip along a border to the light in the next strip inwards."""
    width = max(1, psf.shape[-1] // 16)
    rise = np.zeros(len(psf))
    for profile in (psf.sum(axis=2), psf.sum(axis=1)):
        for line in (profile, profile[:, ::-1]):
            outer, inner = line[:, :width].sum(axis=1), line[:, width:2 * width].sum(axis=1)
            rise = np.maximum(rise, np.where(outer > BORDER_LIGHT, outer / np.maximum(inner, 1e-9), 0))
    return rise


def _ring(psf):
    return psf.sum(axis=(1, 2)) - psf[:, 1:-1, 1:-1].sum(axis=(1, 2))


def _place_gaps(lens):
    for number, name in enumerate(lens.AXES):
        errors = np.stack([np.moveaxis(_interpolation_errors(np.moveaxis(table.astype(float), number, 0),
                                                             getattr(lens, name)), 0, number) for table in lens.psf])
        first = np.zeros(errors.ndim, int)
        first[number + 1] = 1
        yield from _gaps(lens, errors, first, LINES[name])


def _wavelength_gaps(lens):
    places = lens.psf.shape[1:-2]
    errors = np.stack([_interpolation_errors(lens.psf[:, *at].astype(float), lens.wavelengths_nm)
                       for at in np.ndindex(places)], axis=1)
    yield from _gaps(lens, errors.reshape(-1, *places), (1, *(0,) * len(places)), "wavelengths")


def _interpolation_errors(psf, at):
    """L1 distance of each PSF, except the first and last, from a linear interpolation between its neighbours."""
    weight = ((at[1:-1] - at[:-2]) / (at[2:] - at[:-2])).reshape(-1, *(1,) * (psf.ndim - 1))
    return _distance(psf[1:-1], (1 - weight) * psf[:-2] + weight * psf[2:])


def _gaps(lens, errors, first, axis):
    """The largest error of a table without one place or wavelength; half the steps divide the median by 2 to 3."""
    if errors.size == 0:
        return
    worst = greatest(errors)
    yield from graded(errors[worst], GAP_NOTE, GAP_WARNING, "psf",
                      f"{errors[worst]:.2f} in L1 from interpolation between the adjacent {axis}, "
                      f"{place(lens, *np.add(worst, first))}",
                      f"PSFs between {axis} are interpolated, usually with a third to half of this error: give more "
                      f"{axis} near it")


PSF_CHECKS = (_pitch, _focus, _centring, _mirror, _axis_symmetry, _enclosed_energy, _border, _place_gaps,
              _wavelength_gaps)
