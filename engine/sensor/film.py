"""Film: from spectral irradiance to the exposure and density of each emulsion layer."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..image.spectral_image import SpectralImage, check_irradiance
from ..runtime.errors import InputError
from ..runtime.toml_fields import check_known, read_toml
from ..runtime.values import Value
from .electrons import plane_weights

FORMAT, VERSION = "lensfield-film", 1
FIELDS = ("format", "version", "name", "source", "unit", "wavelengths_nm", "log_exposure", "log_sensitivity", "density")
LARGEST_LOG = 30
LOG_M2_PER_J = {"J/m2": 0.0, "erg/cm2": 3.0}
"""What to add to the logarithm of a sensitivity, the reciprocal of an exposure in this unit."""


@dataclass(frozen=True, eq=False, repr=False)
class Film(Value):
    """A film stock.

    Attributes
    ----------
    name : str
    layers : tuple of str
        Names of the emulsion layers, such as red, green and blue for the light that they record.
    wavelengths_nm : array (wavelength,)
        Ascending.
    log_sensitivity : array (layer, wavelength)
        Common logarithm of the spectral sensitivity in m^2 J^-1: the reciprocal of the monochromatic exposure that
        gives the reference density. Linear between the wavelengths; beyond them there is no sensitivity. Data sheets in
        cm^2 erg^-1 state numbers that are smaller by 3.
    log_exposure : array (point,) or None
        Common logarithms, ascending, of a layer's exposure relative to the one that gives the reference density.
    density : array (layer, point) or None
        Density at each of these: the characteristic curves. Linear between the points, held beyond them.
    source : str
        Where the figures come from.

    Raises
    ------
    InputError
        A table is invalid, or tables do not match.
    """

    name: str
    layers: tuple[str, ...]
    wavelengths_nm: np.ndarray
    log_sensitivity: np.ndarray
    log_exposure: np.ndarray | None = None
    density: np.ndarray | None = None
    source: str = field(default="", repr=False)

    def __post_init__(self) -> None:
        for name in ("wavelengths_nm", "log_sensitivity", "log_exposure", "density"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))
        self._check("wavelengths_nm", self.wavelengths_nm, "log_sensitivity", self.log_sensitivity)
        if not self.wavelengths_nm[0] > 0:
            raise InputError(f"film {self.name}", "wavelengths_nm", self.wavelengths_nm[0], "expected positive numbers")
        if (self.log_exposure is None) != (self.density is None):
            raise InputError(f"film {self.name}", "log_exposure, density", "incomplete", "expected both or neither")
        if self.density is not None:
            self._check("log_exposure", self.log_exposure, "density", self.density)
        super().__post_init__()

    def _check(self, along, points, across, values):
        where = f"film {self.name}"
        if points.ndim != 1 or points.size < 2 or not np.all(np.isfinite(points)) or not np.all(np.diff(points) > 0):
            raise InputError(where, along, f"of shape {points.shape}", "expected two or more ascending numbers")
        if not self.layers or values.shape != (len(self.layers), points.size):
            raise InputError(where, across, f"of shape {values.shape}", f"expected {points.size} for each layer")
        if not np.all(np.isfinite(values) & (values <= LARGEST_LOG)):
            raise InputError(where, across, "out of range", f"expected numbers up to {LARGEST_LOG}")


def read_film(path: Path) -> Film:
    """Read a film stock from a TOML file.

        format = "lensfield-film"
        version = 1
        name = "MINE"
        unit = "erg/cm2"               # of the exposures whose reciprocal is the sensitivity, or "J/m2"
        wavelengths_nm = [400, 410]
        log_exposure = [-2, 0, 1]      # optional, with the densities
        [log_sensitivity]
        red = [-1.2, -1.1]
        [density]
        red = [0.1, 0.8, 1.4]

    Raises
    ------
    InputError
        The file is missing or damaged, or a value in it is invalid.

    Examples
    --------
    >>> from pathlib import Path
    >>> from lensfield import read_film
    >>> path = Path("MINE.toml")
    >>> _ = path.write_text('''
    ... format = "lensfield-film"
    ... version = 1
    ... name = "MINE"
    ... unit = "J/m2"
    ... wavelengths_nm = [400, 700]
    ... log_exposure = [-2, 0, 1]
    ... [log_sensitivity]
    ... pan = [-1, -1]
    ... [density]
    ... pan = [0.1, 0.8, 1.4]''')
    >>> read_film(path).layers
    ('pan',)
    """
    table = read_toml(path, FORMAT, VERSION, error=InputError)
    check_known(table, FIELDS)
    log_m2_per_j = LOG_M2_PER_J[table.choice("unit", list(LOG_M2_PER_J))]
    sensitivity = table.number_rows("log_sensitivity", "layer")
    curves = table.number_rows("density", "layer") if "density" in table else {}
    if curves and set(curves) != set(sensitivity):
        raise table.refusal("density", f"expected {', '.join(sensitivity)}")
    try:
        return Film(table.text("name"), tuple(sensitivity), np.array(table.numbers("wavelengths_nm")),
                    np.array(list(sensitivity.values())) + log_m2_per_j,
                    np.array(table.numbers("log_exposure")) if "log_exposure" in table else None,
                    np.array([curves[layer] for layer in sensitivity]) if curves else None, table.line("source"))
    except InputError as error:
        raise error.at(path) from None


def film_exposure(irradiance: SpectralImage, film: Film, shutter_s: float) -> np.ndarray:
    """Exposure of each layer: the integral of E t S over the wavelengths.

    The exposures to all wavelengths add up. The result has no unit: 1 is the exposure that gives the reference density.
    Grain, halation and reciprocity failure are not included.

    Parameters
    ----------
    irradiance : SpectralImage
        W m^-2 nm^-1.
    film : Film
    shutter_s : float

    Returns
    -------
    float32 array (layer, row, column)

    Raises
    ------
    ImageError
        The picture is not irradiance.
    InputError
        The shutter time is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from pathlib import Path
    >>> from lensfield import SpectralImage, film_exposure, read_film
    >>> path = Path("MINE.toml")
    >>> _ = path.write_text('''
    ... format = "lensfield-film"
    ... version = 1
    ... name = "MINE"
    ... unit = "J/m2"
    ... wavelengths_nm = [400, 700]
    ... log_exposure = [-2, 0, 1]
    ... [log_sensitivity]
    ... pan = [-1, -1]
    ... [density]
    ... pan = [0.1, 0.8, 1.4]''')
    >>> light = SpectralImage(np.full((2, 1, 1), 0.1), [400, 700], pitch_um=5, quantity="irradiance")
    >>> film_exposure(light, read_film(path), shutter_s=0.5).round(3).tolist()
    [[[1.5]]]
    """
    check_irradiance(irradiance)
    if not 0 < shutter_s < np.inf:
        raise InputError("exposure", "shutter_s", shutter_s, "expected a positive number")
    weights = plane_weights(irradiance.wavelengths_nm, film.wavelengths_nm, lambda nm: _sensitivity(film, nm))
    return np.tensordot((weights * shutter_s).astype(np.float32), irradiance.frame().cube, 1)


def _sensitivity(film, wavelengths_nm):
    """In m^2 J^-1: array (layer, wavelength)."""
    return 10**np.stack([np.interp(wavelengths_nm, film.wavelengths_nm, each, left=-np.inf, right=-np.inf)
                         for each in film.log_sensitivity])


def film_density(exposure: np.ndarray, film: Film) -> np.ndarray:
    """Density of each layer by the film's characteristic curves.

    Parameters
    ----------
    exposure : array (layer, row, column)
        From `film_exposure`.
    film : Film

    Raises
    ------
    InputError
        The film has no characteristic curves.

    Examples
    --------
    >>> import numpy as np
    >>> from pathlib import Path
    >>> from lensfield import film_density, read_film
    >>> path = Path("MINE.toml")
    >>> _ = path.write_text('''
    ... format = "lensfield-film"
    ... version = 1
    ... name = "MINE"
    ... unit = "J/m2"
    ... wavelengths_nm = [400, 700]
    ... log_exposure = [-2, 0, 1]
    ... [log_sensitivity]
    ... pan = [-1, -1]
    ... [density]
    ... pan = [0.1, 0.8, 1.4]''')
    >>> film_density(np.array([[[1.0, 10.0]]]), read_film(path)).tolist()
    [[[0.8, 1.4]]]
    """
    if film.log_exposure is None or film.density is None:
        raise InputError(f"film {film.name}", "density", "missing", "expected characteristic curves")
    with np.errstate(divide="ignore"):
        log_exposure = np.log10(exposure)
    return np.stack([np.interp(each, film.log_exposure, curve)
                     for each, curve in zip(log_exposure, film.density, strict=True)])
