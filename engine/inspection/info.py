"""The figures of a lens, for the command line and for reports."""

import numpy as np

from ..lens import GridLens, Lens
from ..lens.entrance_pupil import focus_nearness, focus_rise
from ..rays.axial_image import eye_response_at
from ..runtime.values import json_value
from . import grid_curves
from .curves import lateral_colour_um, reference_nm, relative_illumination
from .finding import greatest
from .illumination_band import illumination_band

FRAUNHOFER_F_NM, FRAUNHOFER_C_NM = 486.1, 656.3
LEAN_SIDES = ("on the right", "on the left"), ("at the top", "at the bottom")
UNKNOWN = "unknown"
SHARES = 0.5, 1.0  # of the way to the sensor's edges and corners
NEAR_CORNER = 0.9  # of the half diagonal: the light there is stated with its limits


def lens_info(lens: Lens) -> dict:
    """First-order data, and distortion, relative illumination and lateral colour over the field.

    Returns
    -------
    dict of numbers, lists and strings, ready for JSON. An infinite object distance and an unknown enclosed energy are
    None. `transmittance` is the T of Eq. 2 in eye-weighted white light, and `t_number_effective` the T-stop: the
    effective f-number over its root. `coatings` names the coatings between glass and air, each once, or "unknown"; None
    without a prescription.

    For a rotationally symmetric lens, `heights` contains, for each field height at the reference wavelength: height_mm
    (paraxial), real_height_mm, distortion_percent, relative_illumination (of pictures, with the light that PSFs move),
    lateral_colour_um (real height at F minus real height at C, with both wavelengths clipped to the lens data).

    For other lenses, `places` contains the same for places on the sensor: x_mm, y_mm, ideal_x_mm and ideal_y_mm (in the
    ideal image on the sensor), distortion_percent, relative_illumination, lateral_colour_x_um, lateral_colour_y_um, and
    `covered`, whether the lens data reach there. Places that are mirror images of others are left out. `squeeze`,
    `capture_focal_length_x_mm`, `focus_slope` and `mirrored` are as in `GridLens`.

    `light_near_corner` states the relative illumination at NEAR_CORNER of the half diagonal, and its limits by
    `illumination_band` if the rims are not known exactly; None beyond the lens data.
    """
    short, long = lens.nearest_nm([FRAUNHOFER_F_NM, FRAUNHOFER_C_NM])
    facts = {
        "name": lens.name, "maker": lens.maker, "story": lens.story, "source": lens.source, "notes": lens.notes,
        "efl_mm": lens.efl_mm, "magnification": lens.magnification, "f_number_effective": lens.f_number_effective,
        "central_obstruction": lens.central_obstruction,
        "transmittance": white_transmittance(lens), "t_number_effective": t_number_effective(lens),
        "coatings": _coatings(lens),
        "object_distance_mm": json_value(lens.object_distance_mm), "entrance_pupil_mm": lens.entrance_pupil_mm,
        "capture_focal_length_mm": lens.capture_focal_length_mm, "sensor_mm": list(lens.sensor_mm),
        "reference_wavelength_nm": lens.reference_wavelength_nm, "wavelengths_nm": lens.wavelengths_nm.tolist(),
        **{axis: getattr(lens, axis).tolist() for axis in lens.AXES},
        "psf_samples": list(lens.psf.shape[-2:]), "psf_pitch_um": lens.psf_pitch_um,
        "least_enclosed_energy": json_value(lens.enclosed_energy.min()),
        "lateral_colour_between_nm": [float(short), float(long)],
    }
    facts |= (_over_places if isinstance(lens, GridLens) else _over_heights)(lens, short, long)
    return facts | {"light_near_corner": _light_near_corner(lens, facts)}


def _light_near_corner(lens, facts):
    corner_mm = NEAR_CORNER * np.array(lens.sensor_mm) / 2
    if isinstance(lens, GridLens):
        field = grid_curves.reference_field(lens)
        within, light = field.within(*corner_mm[:, None])[0], field.relative_illumination(*corner_mm[:, None])
    else:
        heights_mm, table = np.array([[row["real_height_mm"], row["relative_illumination"]]
                                      for row in facts["heights"]]).T
        within, light = np.hypot(*corner_mm) <= heights_mm[-1], np.interp([np.hypot(*corner_mm)], heights_mm, table)
    if not within:
        return None
    band = illumination_band(lens.prescription, [NEAR_CORNER], light)
    limits = {} if band is None else dict(zip(("least", "most"), band[:, 0].tolist(), strict=True))
    return {"share": NEAR_CORNER, "light": light.item(), **limits}


def white_transmittance(lens: Lens) -> float:
    """T of Eq. 2 in eye-weighted white light."""
    return float(np.average(lens.transmittance, weights=eye_response_at(lens.wavelengths_nm)))


def t_number_effective(lens: Lens) -> float:
    """The f-number of a lens without losses that is as bright."""
    return lens.f_number_effective / np.sqrt(white_transmittance(lens))


def _coatings(lens):
    """Names of the coatings of surfaces between glass and air, each once; None without a prescription."""
    if lens.prescription is None:
        return None
    return list(dict.fromkeys(name or UNKNOWN for name in lens.prescription.coatings_in_air))


def _coating_lines(info):
    """A line about the coatings of a lens with a prescription."""
    if info["coatings"]:
        ideal = " (unknown ones count as ideal: --coating)" if UNKNOWN in info["coatings"] else ""
        yield f"coatings                 {', '.join(info['coatings'])}{ideal}"


def _near_corner_lines(info):
    """A line about the light near the corner."""
    near = info["light_near_corner"]
    if near:
        limits = (f": {near['least']:.2f} to {near['most']:.2f} by the uncertainty of the rims" if "least" in near
                  else "")
        yield f"light near the corner    {near['light']:.2f} of the middle's at {near['share']:g} of the way{limits}"


def _over_heights(lens, short_nm, long_nm):
    short_um, long_um = lateral_colour_um(lens, [short_nm, long_nm])
    nm = reference_nm(lens)
    reference = lens.at_wavelength(nm)
    off_axis = np.where(lens.heights_mm > 0, lens.heights_mm, 1)
    distortion_percent = 100 * (reference.real_height_mm - lens.heights_mm) / off_axis
    return {"heights": _rows({
        "height_mm": lens.heights_mm, "real_height_mm": reference.real_height_mm,
        "distortion_percent": distortion_percent, "relative_illumination": relative_illumination(lens, nm)[0],
        "lateral_colour_um": short_um - long_um})}


def _over_places(lens, short_nm, long_nm):
    x_mm, y_mm = _places_mm(lens)
    field = grid_curves.reference_field(lens)
    ideal_x_mm, ideal_y_mm = field.source_mm(x_mm, y_mm)
    short_um, long_um = grid_curves.displacement_um(lens, [short_nm, long_nm], x_mm, y_mm)
    colour_x_um, colour_y_um = (short_um - long_um).T
    rows = _rows({
        "x_mm": x_mm, "y_mm": y_mm, "ideal_x_mm": ideal_x_mm, "ideal_y_mm": ideal_y_mm,
        "distortion_percent": grid_curves.distortion_percent(lens, x_mm, y_mm),
        "relative_illumination": field.relative_illumination(x_mm, y_mm),
        "lateral_colour_x_um": colour_x_um, "lateral_colour_y_um": colour_y_um, "covered": field.within(x_mm, y_mm)})
    return {"squeeze": lens.squeeze, "capture_focal_length_x_mm": lens.capture_focal_length_mm / lens.squeeze,
            "focus_slope": list(lens.focus_slope), "focus_lean_deg": focus_lean_deg(lens),
            "mirrored": list(lens.mirrored), "places": rows}


def _places_mm(lens):
    """The middle of the sensor, and places towards its edges and corners: x and y, arrays (place,)."""
    signs = [(1,) if mirrored else (1, -1) for mirrored in lens.mirrored]
    shares = [(0.0, 0.0), *((0.0, sign * share) for sign in signs[1] for share in SHARES),
              *((sign * share, 0.0) for sign in signs[0] for share in SHARES),
              *((up * share, right * share) for up in signs[0] for right in signs[1] for share in SHARES)]
    up, right = np.array(shares).T
    return right * lens.sensor_mm[0] / 2, up * lens.sensor_mm[1] / 2


def focus_lean_deg(lens: GridLens) -> list[float]:
    """Angles by which the plane of focus leans towards the lens on the right of the picture, and at its top."""
    return np.degrees(np.arctan2(focus_rise(lens), focus_nearness(lens))).tolist()


def _rows(columns):
    """Rows of a table, ready for JSON, from its columns."""
    return [dict(zip(columns, row, strict=True)) for row in zip(*map(np.ndarray.tolist, columns.values()), strict=True)]


def _hole(info):
    obstruction = info["central_obstruction"]
    rim = info["f_number_effective"] * np.sqrt(1 - obstruction**2)
    return f": f/{rim:.3g} with a central obstruction of {obstruction:.0%} of its diameter" if obstruction else ""


def lens_text(info: dict) -> str:
    """The figures of `lens_info` as text."""
    distance, enclosed = info["object_distance_mm"], info["least_enclosed_energy"]
    lines = [
        *(info[fact] for fact in ("name", "maker", "story", "source") if info[fact]), "",
        f"focal length             {info['efl_mm']:.5f} mm",
        *_camera_lines(info),
        f"magnification            {info['magnification']:.6f}",
        f"effective f-number       {info['f_number_effective']:.3f}{_hole(info)}",
        f"effective T-stop         {info['t_number_effective']:.3f}: T = {info['transmittance']:.3f} in white light",
        *_coating_lines(info),
        *_near_corner_lines(info),
        f"object distance          {'infinity' if distance is None else f'{distance:g} mm'}",
        f"sensor                   {info['sensor_mm'][0]:g} x {info['sensor_mm'][1]:g} mm",
        f"wavelengths              {info['wavelengths_nm'][0]:g} to {info['wavelengths_nm'][-1]:g} nm"
        f" ({len(info['wavelengths_nm'])}), reference {info['reference_wavelength_nm']:g} nm",
        f"point spread functions   {info['psf_samples'][0]} x {info['psf_samples'][1]} samples of"
        f" {info['psf_pitch_um']:g} um, containing "
        + ("an unknown part of the light" if enclosed is None else f"at least {enclosed:.1%} of the light"), "",
        *(_place_lines(info) if "places" in info else _height_lines(info)),
    ]
    if info["notes"]:
        lines += ["", info["notes"]]
    return "\n".join(lines)


def _camera_lines(info):
    """Lines about the camera of a lens without rotational symmetry."""
    if "places" not in info:
        return
    yield (f"camera's focal length    {info['capture_focal_length_mm']:.5f} mm along the height, "
           f"{info['capture_focal_length_x_mm']:.5f} mm along the width")
    yield f"squeeze                  {info['squeeze']:.4f}"
    leans = [f"{abs(degrees):.1f} degrees towards the lens {side[degrees < 0]}" for degrees, side in
             zip(info["focus_lean_deg"], LEAN_SIDES, strict=True) if degrees]
    if leans:
        yield f"plane of focus leans     {', '.join(leans)}"


def _height_lines(info):
    short, long = info["lateral_colour_between_nm"]
    yield "field height  real height  distortion  relative      lateral colour"
    yield f"(paraxial)                             illumination  {short:g} - {long:g} nm"
    for row in info["heights"]:
        yield (f"{row['height_mm']:9.3f} mm {row['real_height_mm']:9.4f} mm {row['distortion_percent']:9.2f} %"
               f" {row['relative_illumination']:12.4f} {row['lateral_colour_um']:12.2f} um")


def _place_lines(info):
    short, long = info["lateral_colour_between_nm"]
    yield "on the sensor          ideal image              distortion  relative      lateral colour"
    yield f"{'x':>8} {'y':>8} mm {'x':>10} {'y':>10} mm              illumination  {short:g} - {long:g} nm: x, y"
    for figures in info["places"]:
        row = {name: round(value, 4) + 0.0 for name, value in figures.items()}  # not -0.0000
        yield (f"{row['x_mm']:8.3f} {row['y_mm']:8.3f} mm {row['ideal_x_mm']:10.4f} {row['ideal_y_mm']:10.4f} mm"
               f" {row['distortion_percent']:8.2f} % {row['relative_illumination']:12.4f}"
               f" {row['lateral_colour_x_um']:9.2f} {row['lateral_colour_y_um']:8.2f} um"
               + ("" if row["covered"] else "  beyond the lens data"))


def table_summary(lens: Lens) -> str:
    """The size of a lens's tables, and the least light that a PSF of them holds, in one line."""
    places, least = (_nodes if isinstance(lens, GridLens) else _heights)(lens, *greatest(-lens.enclosed_energy))
    return (f"f = {lens.efl_mm:.5g} mm, f/{lens.f_number_effective:.3g}, {places} x {lens.wavelengths_nm.size} "
            f"wavelengths; PSFs of {lens.psf.shape[-1]} x {lens.psf.shape[-1]} samples of {lens.psf_pitch_um:g} um "
            f"contain at least {lens.enclosed_energy.min():.2%} of the light (minimum at {least})")


def _heights(lens, wave, height):
    """The number and extent of field heights, and one of them with its wavelength, as text."""
    return (f"{lens.heights_mm.size} heights to {lens.heights_mm[-1]:.4g} mm",
            f"{lens.heights_mm[height]:.4g} mm, {lens.wavelengths_nm[wave]:g} nm")


def _nodes(lens, wave, row, column):
    """The same for nodes."""
    return (f"{lens.y_mm.size} x {lens.x_mm.size} nodes to y = {lens.y_mm[-1]:.4g} mm, x = {lens.x_mm[-1]:.4g} mm",
            f"x = {lens.x_mm[column]:.4g} mm, y = {lens.y_mm[row]:.4g} mm, {lens.wavelengths_nm[wave]:g} nm")
