"""The choice of as few rendered wavelengths as possible, and the estimate of light at all others.

Light is L(λ) = Σ_g S_g(λ) T_g(λ): the spectra S of the lamps, which may be spiky, times the transport T, the effect of
surfaces and volumes on white light. Transports are products of the scene's reflectances and colours, which are few and
smooth. The Wiener estimate, which is the linear estimate with the least error by the covariance of such products,
therefore computes T at all wavelengths from its values at some, and predicts its error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.errors import InputError
from ..runtime.setting import check_choices, setting
from ..runtime.values import Value
from .colour_difference import ciede2000, lab_from_xyz
from .repeated_colour import RepeatedColour
from .spectra import colour_matching, reflectance_basis, trapezoid_weights

STANDARD, REFERENCE = "standard", "reference"
IMAGE_WAVELENGTHS = "400:700:21"  # default of a scene's lens image
RGB_WAVELENGTHS = "400:700:9"  # for RGB pictures, which do not contain finer spectra
PREVIEW_WAVELENGTHS = 3
STANDARD_COLOUR_ERROR = 1.0  # CIEDE2000: just noticeable
ERROR_PERCENTILE = 95
GRID_STEP_NM = 5.0
SENSOR_BANDS_NM, SENSOR_WIDTH_NM = (450.0, 540.0, 610.0), 30.0  # Gaussian; the width is the standard deviation
GREY = 1e-4  # largest relative change over the wavelengths that counts as grey
SAMPLES, TEST_SAMPLES = 3000, 1000  # transports for the covariance, and to test the estimate
MIXED_COLOURS = 64  # at random, for colours that nodes compute
SMOOTH_NM, SMOOTH_SHARE = 25.0, 1e-5  # of the covariance: prior for spectra that the scene does not list
NOISE_SHARE = 1e-7
DEEP_EVERY = 3  # one in three training transports also passes a repeated colour
GREY_WEIGHT = 100.0  # of the constant among transports: grey must stay grey
FOREIGN_SURPRISE = 8  # above this, a scene has spectra that it does not list; without such spectra it is up to 5
Curve = Callable[[np.ndarray], np.ndarray]  # values at wavelengths in nm
LEAST_WEIGHT = 1.0  # added to the eye's and the lamps' weights, whose means are 1, for invisible and unlit wavelengths


@dataclass(frozen=True)
class SpectralOptions:
    """Target accuracy of spectra and colours.

    Attributes
    ----------
    tier : "preview", "standard" or "reference"
        "preview" renders one pass of three wavelengths; "standard" as many as keep colour errors within
        STANDARD_COLOUR_ERROR; "reference" renders every output wavelength.
    colour_error : float, optional
        Limit of CIEDE2000 for 95 % of the scene's possible colours, instead of the standard one.
    sensor_error : float, optional
        Additional limit of the relative RMS error in three broad sensor bands.
    """

    tier: str = setting(
        STANDARD, name="Quality", text="Accuracy of colours and blur; higher tiers take longer",
        panel="",
        choices={"preview": ("Preview", "One Cycles render of three wavelengths; the others are roughly estimated "
                                        "from these, pure reds, greens and blues to 2 %. Up to 10 % of a point's light "
                                        "may land in the wrong place"),
                 STANDARD: ("Standard", "Cycles renders enough wavelengths to keep colour errors barely visible, "
                                          "often 6 to 12; the others are estimated from these. Up to 1 % of a point's "
                                          "light may land in the wrong place"),
                 REFERENCE: ("Reference", "For measurements: Cycles renders each wavelength, without clamping or "
                                          "denoising. Up to 0.1 % of a point's light may land in the wrong place")})
    colour_error: float | None = setting(
        None, name="Colour Error", kind=float, limits=(0.001, np.inf), soft_limits=(0.05, 5.0), precision=2,
        panel="", panel_default=STANDARD_COLOUR_ERROR, metavar="DELTA_E",
        unset=f"{STANDARD_COLOUR_ERROR:g} in standard",
        text="Limit on the CIEDE2000 difference of 95 % of the scene's possible colours: 1 is just visible. Smaller "
             "limits take more Cycles passes")
    sensor_error: float | None = setting(
        None, name="Sensor Error", kind=float, metavar="FRACTION",
        text="Limit on the relative RMS error of three broad sensor bands")

    def __post_init__(self):
        check_choices(self)
        for field, example in (("colour_error", 0.5), ("sensor_error", 0.01)):
            value = getattr(self, field)
            if value is not None and not (isinstance(value, (int, float)) and 0 < value < np.inf):
                raise InputError("options", field, value, f"expected a number above 0, such as {example}")
            if value is not None and self.tier != STANDARD:
                raise InputError("options", field, value, f"leave it out: the tier is {self.tier!r}")

    def met_by(self, errors: tuple[float, float]) -> bool:
        """Whether a colour error and a sensor error are small enough."""
        colour, sensor = errors
        limit = self.colour_error or (np.inf if self.sensor_error else STANDARD_COLOUR_ERROR)
        return colour <= limit and sensor <= (self.sensor_error or np.inf)


@dataclass(frozen=True, eq=False, repr=False)
class WavelengthChoice(Value):
    """The wavelengths to render, and the weights that estimate the output wavelengths from them.

    Attributes
    ----------
    nodes_nm : float64 array (node,)
        Ascending.
    output_nm : float64 array (wavelength,)
    weights : float64 array (wavelength, node)
    colour_error, sensor_error : float
        Predictions: the CIEDE2000 that 95 % of transports do not exceed, and the relative RMS error in the worst of
        three sensor bands.
    spectral_error : float
        Prediction: relative RMS error at the worst output wavelength.
    others : float64 array (node, node)
        Weights that estimate each node from the others.
    expected_miss : float
        Expected error of these estimates: RMS at the worst node, relative to the transports' RMS.
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
        """Error of the nodes' estimates from one another, relative to `expected_miss`.

        At most a few, unless the scene has spectra that it does not list.

        Parameters
        ----------
        planes : array (node, ...)
            Rendered transport without noise.
        """
        if not self.expected_miss:
            return 0.0
        return _cross_error(planes.reshape(len(planes), -1).T, self.others) / self.expected_miss


def choose_wavelengths(factors: Sequence[Curve], lamps: Sequence[Curve], output_nm: ArrayLike,
                   options: SpectralOptions = SpectralOptions(), *, repeated: Sequence[RepeatedColour] = (),
                   mixed_colours: bool = False, per_pass: int = 3, dispersive: bool = False) -> WavelengthChoice:
    """Choose the fewest passes that meet the target accuracy at the output wavelengths.

    Parameters
    ----------
    factors : sequence of callable (wavelengths_nm) -> values
        Factors of light along its path: reflectances, transmittances, tints.
    lamps : sequence of callable (wavelengths_nm) -> values
        Spectral densities of the lamps, for colour errors.
    output_nm : ascending array (wavelength,)
    options : SpectralOptions
    repeated : sequence of RepeatedColour
        Colours of glass and volumes; the colour error is also predicted for each of them alone.
    mixed_colours : bool
        Whether nodes compute further colours, such as textures.
    per_pass : 3 or 1
        Wavelengths per pass.
    dispersive : bool
        Whether the light's path depends on its wavelength.
    """
    output_nm = np.asarray(output_nm, dtype=float)
    if dispersive:
        return _all_rendered(output_nm, "glass refracts each wavelength differently")
    statistics = _Statistics(factors, lamps, output_nm, mixed_colours, repeated)
    if statistics.grey:
        return statistics.choice([statistics.middle], "all surfaces are grey")
    if options.tier == REFERENCE:
        return _all_rendered(output_nm, "each wavelength is rendered")
    most = min(output_nm.size, statistics.most_nodes + per_pass)
    for count in range(per_pass, most, per_pass) if output_nm.size > PREVIEW_WAVELENGTHS else ():
        if options.tier == "preview" and count < PREVIEW_WAVELENGTHS:
            continue
        nodes = statistics.best_nodes(count)
        if options.tier == "preview" or options.met_by(statistics.errors(nodes)):
            return statistics.choice(nodes, "the other wavelengths are estimated from these")
    return _all_rendered(output_nm, "fewer wavelengths do not meet the target")


def _all_rendered(output_nm, reason):
    """Every output wavelength rendered, without estimates."""
    unit = np.eye(output_nm.size)
    return WavelengthChoice(output_nm, output_nm, unit, 0.0, 0.0, 0.0, np.zeros_like(unit), 0.0, reason)


class _Statistics:
    """Statistics of a scene's transports, over a grid of wavelengths and at the output wavelengths."""

    def __init__(self, factors, lamps, output_nm, mixed_colours, repeated):
        first, last = output_nm[[0, -1]]
        self._grid_nm = np.linspace(first, last, max(int(round((last - first) / GRID_STEP_NM)) + 1, 1))
        self._output_nm = output_nm
        wavelengths_nm = np.concatenate([self._grid_nm, output_nm])
        rng = np.random.default_rng(5)
        deep = [colour.transports(wavelengths_nm) for colour in repeated]
        deep = [each for each in deep if np.any(np.ptp(each, axis=1) > GREY * each.max(axis=1))]
        known = [*(factor(wavelengths_nm) for factor in factors), *(transports[0] for transports in deep)]
        known = np.array(known).reshape(-1, wavelengths_nm.size)
        known = known[np.unique(np.round(known, 3), axis=0, return_index=True)[1]]  # without duplicates
        if mixed_colours and len(known):  # as many as the mixed colours, to count as much
            known = np.repeat(known, -(-MIXED_COLOURS // len(known)), axis=0)
        mixed = rng.random((MIXED_COLOURS * mixed_colours, 3))**2 @ reflectance_basis(wavelengths_nm).T
        curves = np.concatenate([np.ones((1, wavelengths_nm.size)), known, mixed])
        self.grey = bool(np.all(np.ptp(curves, axis=1) <= GREY * curves.max(axis=1)))
        self.middle = self._grid_nm.size // 2
        self.most_nodes = self._grid_nm.size
        training = _transports(curves, SAMPLES, rng)
        if deep:  # a share of the transports also passes through these
            passed = np.concatenate(deep)
            training[::DEEP_EVERY] *= passed[rng.integers(0, len(passed), len(training[::DEEP_EVERY]))]
        smooth = np.exp(-0.5 * ((wavelengths_nm[:, None] - wavelengths_nm) / SMOOTH_NM)**2)
        self._covariance = training.T @ training / SAMPLES
        power = np.diag(self._covariance).mean()
        self._covariance += power * (SMOOTH_SHARE * smooth + GREY_WEIGHT)
        self._noise = NOISE_SHARE * power
        test = _transports(curves, TEST_SAMPLES, rng)
        self._test, self._test_output = self._split(test)
        self._deep = [self._split(transports) for transports in deep]
        self._lights = [lamp(output_nm) for lamp in lamps]

    def _split(self, transports):
        """Split transports into the grid's wavelengths and the output wavelengths."""
        return transports[:, :self._grid_nm.size], transports[:, self._grid_nm.size:]

    def weights(self, nodes):
        """Weights that estimate the wavelengths of the grid and of the output from nodes of the grid."""
        weights = self._best_weights(nodes)
        return weights / weights.sum(axis=1, keepdims=True)  # grey stays exactly grey

    def _best_weights(self, nodes):
        of_nodes = self._covariance[np.ix_(nodes, nodes)] + self._noise * np.eye(len(nodes))
        return np.linalg.solve(of_nodes, self._covariance[nodes]).T

    def best_nodes(self, count):
        """Nodes of the grid with the least expected error: added one by one, then each replaced twice, given the rest.
        """
        count = min(count, self.most_nodes)
        nodes = []
        for _ in range(count):
            nodes.append(self._best_addition(nodes))
        for _ in range(2):
            for index in range(count):
                nodes[index] = self._best_addition(nodes[:index] + nodes[index + 1:])
        return sorted(nodes)

    def _best_addition(self, nodes):
        """The node that most reduces the remaining error of the others."""
        grid = slice(self._grid_nm.size)
        left = self._covariance[grid, grid]
        if nodes:
            left = left - self._best_weights(nodes)[grid] @ self._covariance[nodes, grid]
        gains = (self._importance()[:, None] * left**2).sum(axis=0) / (np.maximum(np.diag(left), 0) + self._noise)
        gains[nodes] = -1
        return int(np.argmax(gains))

    def _importance(self):
        """Weight of an error at each wavelength of the grid, by the eye's response and the lamps."""
        response = colour_matching(self._grid_nm).sum(axis=1)
        weight = response / max(response.mean(), 1e-12) + LEAST_WEIGHT
        lights = [np.interp(self._grid_nm, self._output_nm, light) for light in self._lights]
        lit = sum((light / light.mean() for light in lights if light.mean() > 0), np.zeros(self._grid_nm.size))
        return (weight * (lit / max(lit.mean(), 1e-12) + LEAST_WEIGHT))**2

    def errors(self, nodes):
        """Colour and sensor error of the estimate from these nodes: the largest over the test transports and over each
        repeated colour's transports.

        Computed at the output wavelengths, like the picture's colours; they include a spiky lamp's light.
        """
        weights = self.weights(nodes)[self._grid_nm.size:].T
        errors = [self._errors_of(true, on_grid[:, nodes] @ weights, light)
                  for on_grid, true in ((self._test, self._test_output), *self._deep)
                  for light in self._lights]
        return tuple(np.max(errors, axis=0))

    def _errors_of(self, true, estimated, light):
        nm = self._output_nm
        matching, light = colour_matching(nm), light * trapezoid_weights(nm)
        return (_colour_error(true * light, estimated * light, light @ matching, matching),
                sensor_error(true * light, estimated * light, nm))

    def choice(self, nodes, reason):
        """The WavelengthChoice with these nodes."""
        weights, others = self.weights(nodes)[self._grid_nm.size:], self._others(nodes)
        missed = self._test[:, nodes] @ weights.T - self._test_output
        spectral_error = np.sqrt(((missed**2).mean(axis=0) / (self._test_output**2).mean(axis=0)).max())
        colour_error, sensor_error = (0.0, 0.0) if self.grey else self.errors(nodes)
        return WavelengthChoice(
            self._grid_nm[nodes], self._output_nm, weights, float(colour_error), float(sensor_error),
            0.0 if self.grey else float(spectral_error), others, _cross_error(self._test[:, nodes], others), reason)

    def _others(self, nodes):
        """Weights that estimate each node from the others; zero for a single node."""
        others = np.zeros((len(nodes), len(nodes)))
        for index in range(len(nodes) if len(nodes) > 1 else 0):
            rest = [node for node in range(len(nodes)) if node != index]
            others[index, rest] = self.weights([nodes[node] for node in rest])[nodes[index]]
        return others


def _transports(curves, count, rng):
    """Random transports (count, wavelength): products of up to three factors with random powers.

    A third have a single factor with power 1. Powers represent bounces, and the depth of absorbing volumes.
    """
    which = rng.integers(0, len(curves), (count, 3))
    powers = rng.gamma(1.0, 1.0, (count, 3)) * (rng.random((count, 3)) < (1.0, 0.6, 0.3))
    powers[:count // 3] = (1, 0, 0)
    logarithms = np.log(np.maximum(curves, 1e-4))
    return np.exp(sum(powers[:, [factor]] * logarithms[which[:, factor]] for factor in range(3)))


def _cross_error(transports, others):
    """Error of each node's estimate from the others: RMS at the worst node relative to the transports' RMS."""
    power = (transports**2).mean()
    if not others.any() or not 0 < power < np.inf:
        return 0.0
    return float(np.sqrt(((transports - transports @ others.T)**2).mean(axis=0).max() / power))


def _colour_error(true, estimated, white, matching):
    if not white[1] > 0:
        return 0.0
    white = np.maximum(white, 1e-6 * white[1])  # two of them may be 0 under a single spectral line
    differences = ciede2000(lab_from_xyz(true @ matching, white),
                            lab_from_xyz(np.maximum(estimated, 0) @ matching, white))
    return np.percentile(differences, ERROR_PERCENTILE)


def sensor_error(true: np.ndarray, estimated: np.ndarray, wavelengths_nm: np.ndarray) -> float:
    """Relative RMS error of the worst of three sensor bands, over spectra (spectrum, wavelength)."""
    bands = np.exp(-0.5 * ((wavelengths_nm[:, None] - np.array(SENSOR_BANDS_NM)) / SENSOR_WIDTH_NM)**2)
    signal, error = true @ bands, (estimated - true) @ bands
    mean = np.sqrt((signal**2).mean(axis=0))
    return np.max(np.sqrt((error**2).mean(axis=0)) / np.where(mean > 0, mean, 1))
