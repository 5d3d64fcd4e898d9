"""At how few wavelengths a scene has to be rendered, and how the light at all others follows.

Light is L(λ) = Σ_g S_g(λ) T_g(λ): the spectra S of the lamps, which may be spiky, times what surfaces and volumes
make of white light on its way, the transport T. It is made of products of the scene's own reflectances and colours, and
these are few and smooth. So the linear estimate of least error, from what such products have in common (Wiener's),
gives T at all wavelengths from its values at some, and tells how far it errs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..values import Value
from .colour_difference import ciede2000, lab_from_xyz
from .spectra import colour_matching, reflectance_basis, trapezoid_weights

TIERS = ("preview", "standard", "reference")
UNFIT = ("refuse", "render")  # what to do about what cannot be rendered by wavelengths
IMAGE_WAVELENGTHS = "400:700:21"  # of a scene's lens image, where none are asked for
RGB_WAVELENGTHS = "400:700:9"  # that a picture in RGB is upsampled to: it holds no finer spectra
PREVIEW_WAVELENGTHS = 3
STANDARD_COLOUR_ERROR = 1.0  # CIEDE2000: what is just seen
ERROR_PERCENTILE = 95
GRID_STEP_NM = 5.0
SENSOR_BANDS_NM, SENSOR_WIDTH_NM = (450.0, 540.0, 610.0), 30.0  # Gaussian, the width being their standard deviation
GREY = 1e-4  # relative change over the wavelengths of what is called grey
SAMPLES, TRIED_SAMPLES = 3000, 1000  # of transport, to learn from and to try the estimate on
MIXED_COLOURS = 64  # at random, for colours that only nodes know
SMOOTH_NM, SMOOTH_SHARE = 25.0, 1e-5  # of the covariance: what is expected of a spectrum that nobody told of
NOISE_SHARE = 1e-7
GREY_WEIGHT = 100.0  # of the constant among transports: what is grey has to stay grey
FOREIGN_SURPRISE = 8  # from which on there are spectra in a scene that nobody told of; without them it is up to 5
Curve = Callable[[np.ndarray], np.ndarray]  # values at wavelengths in nm
UNSEEN = 1.0  # weight of wavelengths that no eye sees and no lamp gives, beside the mean of what these do


@dataclass(frozen=True)
class SpectralOptions:
    """How true spectra and colours are asked to be.

    Attributes
    ----------
    tier : "preview", "standard" or "reference"
        "preview" takes one pass of three wavelengths; "standard" as many as keep colour errors within
        STANDARD_COLOUR_ERROR; "reference" renders every wavelength that is asked for.
    colour_error : float, optional
        CIEDE2000 that 95 % of the scene's possible colours are to stay within, in place of the standard one.
    sensor_error : float, optional
        Relative RMS error that three broad sensor bands are to stay within as well.
    """

    tier: str = "standard"
    colour_error: float | None = None
    sensor_error: float | None = None

    def __post_init__(self):
        if self.tier not in TIERS:
            raise InputError("options", "tier", self.tier, f"expected {' or '.join(TIERS)}")
        for field, example in (("colour_error", 0.5), ("sensor_error", 0.01)):
            value = getattr(self, field)
            if value is not None and not (isinstance(value, (int, float)) and 0 < value < np.inf):
                raise InputError("options", field, value, f"expected a number above 0, such as {example}")
            if value is not None and self.tier != "standard":
                raise InputError("options", field, value, f"leave it out: the tier is {self.tier!r}")

    def met_by(self, errors: tuple[float, float]) -> bool:
        """Whether a colour error and a sensor error are small enough."""
        colour, sensor = errors
        limit = self.colour_error or (np.inf if self.sensor_error else STANDARD_COLOUR_ERROR)
        return colour <= limit and sensor <= (self.sensor_error or np.inf)


@dataclass(frozen=True, eq=False, repr=False)
class WavelengthChoice(Value):
    """The wavelengths to render at, and how those asked for follow from them.

    Attributes
    ----------
    nodes_nm : float64 array (node,)
        Ascending.
    output_nm : float64 array (wavelength,)
    weights : float64 array (wavelength, node)
    colour_error, sensor_error : float
        Predicted: CIEDE2000, and relative RMS of the worst of three sensor bands; 95 % of transports err by less than
        the first.
    spectral_error : float
        Predicted: relative RMS at the worst of the wavelengths asked for.
    others : float64 array (node, node)
        Estimates each node from the others.
    expected_miss : float
        By how much these estimates err, RMS at the worst node, relative to the transports' own.
    reason : str
    """

    nodes_nm: np.ndarray
    output_nm: np.ndarray
    weights: np.ndarray
    colour_error: float
    sensor_error: float
    spectral_error: float
    others: np.ndarray
    expected_miss: float
    reason: str

    def surprise(self, planes: np.ndarray) -> float:
        """How much worse the nodes tell one another than expected: a few at most in a scene that was understood.

        Parameters
        ----------
        planes : array (node, ...)
            Rendered transport, free of noise.
        """
        if not self.expected_miss:
            return 0.0
        return _misses(planes.reshape(len(planes), -1).T, self.others) / self.expected_miss


def choose_wavelengths(factors: Sequence[Curve], lamps: Sequence[Curve], output_nm: ArrayLike,
                   options: SpectralOptions = SpectralOptions(), *, mixed_colours: bool = False, per_pass: int = 3,
                   dispersive: bool = False) -> WavelengthChoice:
    """The fewest passes that give the light at the wavelengths asked for as truly as asked.

    Parameters
    ----------
    factors : sequence of callable (wavelengths_nm) -> values
        What multiplies light on its way: reflectances, transmittances, tints.
    lamps : sequence of callable (wavelengths_nm) -> values
        Spectral densities of the lamps, for judging colours by.
    output_nm : ascending array (wavelength,)
    options : SpectralOptions
    mixed_colours : bool
        Whether there are colours that only nodes know, such as those of textures.
    per_pass : 3 or 1
        Wavelengths that a pass carries.
    dispersive : bool
        Whether light of each wavelength goes a way of its own.
    """
    output_nm = np.asarray(output_nm, dtype=float)
    if dispersive:
        return _as_asked(output_nm, "glass bends each wavelength by itself")
    statistics = _Statistics(factors, lamps, output_nm, mixed_colours)
    if statistics.grey:
        return statistics.choice([statistics.middle], "all surfaces are grey")
    if options.tier == "reference":
        return _as_asked(output_nm, "each wavelength is rendered")
    most = min(output_nm.size, statistics.most_nodes + per_pass)
    for count in range(per_pass, most, per_pass) if output_nm.size > PREVIEW_WAVELENGTHS else ():
        if options.tier == "preview" and count < PREVIEW_WAVELENGTHS:
            continue
        nodes = statistics.best_nodes(count)
        if options.tier == "preview" or options.met_by(statistics.errors(nodes)):
            return statistics.choice(nodes, "the other wavelengths follow from these")
    return _as_asked(output_nm, "no fewer wavelengths tell them all")


def _as_asked(output_nm, reason):
    """Every wavelength rendered: nothing is estimated."""
    unit = np.eye(output_nm.size)
    return WavelengthChoice(output_nm, output_nm, unit, 0.0, 0.0, 0.0, np.zeros_like(unit), 0.0, reason)


class _Statistics:
    """What the transports of a scene have in common, over a grid of wavelengths and at those asked for."""

    def __init__(self, factors, lamps, output_nm, mixed_colours):
        first, last = output_nm[[0, -1]]
        self._grid_nm = np.linspace(first, last, max(int(round((last - first) / GRID_STEP_NM)) + 1, 1))
        self._output_nm = output_nm
        wavelengths_nm = np.concatenate([self._grid_nm, output_nm])
        rng = np.random.default_rng(5)
        known = np.array([factor(wavelengths_nm) for factor in factors]).reshape(-1, wavelengths_nm.size)
        known = known[np.unique(np.round(known, 3), axis=0, return_index=True)[1]]  # each once, whoever has it
        if mixed_colours and len(known):  # half of all, not to be lost among the others
            known = np.repeat(known, -(-MIXED_COLOURS // len(known)), axis=0)
        mixed = rng.random((MIXED_COLOURS * mixed_colours, 3))**2 @ reflectance_basis(wavelengths_nm).T
        curves = np.concatenate([np.ones((1, wavelengths_nm.size)), known, mixed])
        self.grey = bool(np.all(np.ptp(curves, axis=1) <= GREY * curves.max(axis=1)))
        self.middle = self._grid_nm.size // 2
        self.most_nodes = self._grid_nm.size
        learnt = _transports(curves, SAMPLES, rng)
        smooth = np.exp(-0.5 * ((wavelengths_nm[:, None] - wavelengths_nm) / SMOOTH_NM)**2)
        self._covariance = learnt.T @ learnt / SAMPLES
        power = np.diag(self._covariance).mean()
        self._covariance += power * (SMOOTH_SHARE * smooth + GREY_WEIGHT)
        self._noise = NOISE_SHARE * power
        tried = _transports(curves, TRIED_SAMPLES, rng)
        self._tried, self._tried_output = tried[:, :self._grid_nm.size], tried[:, self._grid_nm.size:]
        self._lights = [lamp(output_nm) for lamp in lamps]

    def weights(self, nodes):
        """Estimate of all wavelengths, of the grid and those asked for, from nodes of the grid."""
        weights = self._best_weights(nodes)
        return weights / weights.sum(axis=1, keepdims=True)  # to the last digit, grey stays grey

    def _best_weights(self, nodes):
        of_nodes = self._covariance[np.ix_(nodes, nodes)] + self._noise * np.eye(len(nodes))
        return np.linalg.solve(of_nodes, self._covariance[nodes]).T

    def best_nodes(self, count):
        """Nodes of the grid of least expected error: one after another, then each once more beside the others."""
        count = min(count, self.most_nodes)
        nodes = []
        for _ in range(count):
            nodes.append(self._best_beside(nodes))
        for _ in range(2):
            for index in range(count):
                nodes[index] = self._best_beside(nodes[:index] + nodes[index + 1:])
        return sorted(nodes)

    def _best_beside(self, nodes):
        """The node that takes away the most of the error that others leave."""
        grid = slice(self._grid_nm.size)
        left = self._covariance[grid, grid]
        if nodes:
            left = left - self._best_weights(nodes)[grid] @ self._covariance[nodes, grid]
        gains = (self._importance()[:, None] * left**2).sum(axis=0) / (np.maximum(np.diag(left), 0) + self._noise)
        gains[nodes] = -1
        return int(np.argmax(gains))

    def _importance(self):
        """How much an error counts at each wavelength of the grid: by the eye and the lamps."""
        seen = colour_matching(self._grid_nm).sum(axis=1)
        weight = seen / max(seen.mean(), 1e-12) + UNSEEN
        lights = [np.interp(self._grid_nm, self._output_nm, light) for light in self._lights]
        lit = sum((light / light.mean() for light in lights if light.mean() > 0), np.zeros(self._grid_nm.size))
        return (weight * (lit / max(lit.mean(), 1e-12) + UNSEEN))**2

    def errors(self, nodes):
        """Colour error and sensor error of the estimate from these nodes, over the transports that were tried.

        They are judged as the picture will be, by its wavelengths: of a spiky lamp these have its light.
        """
        true, nm = self._tried_output, self._output_nm
        estimated = self._tried[:, nodes] @ self.weights(nodes)[self._grid_nm.size:].T
        matching, widths_nm = colour_matching(nm), trapezoid_weights(nm)
        errors = [(_colour_error(true * light, estimated * light, light @ matching, matching),
                   sensor_error(true * light, estimated * light, nm))
                  for light in (light * widths_nm for light in self._lights)]
        return tuple(np.max(errors, axis=0))

    def choice(self, nodes, reason):
        """The WavelengthChoice with these nodes."""
        weights, others = self.weights(nodes)[self._grid_nm.size:], self._others(nodes)
        missed = self._tried[:, nodes] @ weights.T - self._tried_output
        spectral_error = np.sqrt(((missed**2).mean(axis=0) / (self._tried_output**2).mean(axis=0)).max())
        colour_error, sensor_error = (0.0, 0.0) if self.grey else self.errors(nodes)
        return WavelengthChoice(
            self._grid_nm[nodes], self._output_nm, weights, float(colour_error), float(sensor_error),
            0.0 if self.grey else float(spectral_error), others, _misses(self._tried[:, nodes], others), reason)

    def _others(self, nodes):
        """What estimates each node from the others; of a single one nothing does."""
        others = np.zeros((len(nodes), len(nodes)))
        for index in range(len(nodes) if len(nodes) > 1 else 0):
            rest = [node for node in range(len(nodes)) if node != index]
            others[index, rest] = self.weights([nodes[node] for node in rest])[nodes[index]]
        return others


def _transports(curves, count, rng):
    """Random transports (count, wavelength): up to three factors, each met several times or in part, a third just once.

    Powers stand for bounces, and for the depth of what absorbs.
    """
    which = rng.integers(0, len(curves), (count, 3))
    powers = rng.gamma(1.0, 1.0, (count, 3)) * (rng.random((count, 3)) < (1.0, 0.6, 0.3))
    powers[:count // 3] = (1, 0, 0)
    logarithms = np.log(np.maximum(curves, 1e-4))
    return np.exp(sum(powers[:, [met]] * logarithms[which[:, met]] for met in range(3)))


def _misses(transports, others):
    """How far nodes lie from what the others tell: RMS of the worst node relative to that of the transports."""
    power = (transports**2).mean()
    if not others.any() or not 0 < power < np.inf:
        return 0.0
    return float(np.sqrt(((transports - transports @ others.T)**2).mean(axis=0).max() / power))


def _colour_error(true, estimated, white, matching):
    if not white[1] > 0:
        return 0.0
    white = np.maximum(white, 1e-6 * white[1])  # of a light of a single line two of them may be nought
    differences = ciede2000(lab_from_xyz(true @ matching, white),
                            lab_from_xyz(np.maximum(estimated, 0) @ matching, white))
    return np.percentile(differences, ERROR_PERCENTILE)


def sensor_error(true: np.ndarray, estimated: np.ndarray, wavelengths_nm: np.ndarray) -> float:
    """Relative RMS error of the worst of three sensor bands, over spectra (spectrum, wavelength)."""
    bands = np.exp(-0.5 * ((wavelengths_nm[:, None] - np.array(SENSOR_BANDS_NM)) / SENSOR_WIDTH_NM)**2)
    signal, error = true @ bands, (estimated - true) @ bands
    mean = np.sqrt((signal**2).mean(axis=0))
    return np.max(np.sqrt((error**2).mean(axis=0)) / np.where(mean > 0, mean, 1))
