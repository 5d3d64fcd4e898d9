"""The loop `lf_read` in numpy, with the same bits: for machines without a library, and the reference for its tests."""

import numpy as np

from .pixels import Pixels

FEW_E, MOST_E, MOST_COUNTED = 32, 1e30, 128  # as in reading.c
DIFFERENCES, NOISE, COUNTS = range(3)  # what random words are for
TURNS = 13, 15, 26, 6, 17, 29, 16, 24
WHOLE = np.float32(12582912)  # adding and subtracting it rounds a float below 2^22 to an integer
LOGARITHM = (7.0376836292e-2, -1.1514610310e-1, 1.1676998740e-1, -1.2420140846e-1, 1.4249322787e-1, -1.6668057665e-1,
             2.0000714765e-1, -2.4999993993e-1, 3.3333331174e-1)
SINE = -2.50521084e-8, 2.75573192e-6, -1.98412698e-4, 8.33333333e-3, -1.66666667e-1, 1
COSINE = 2.08767570e-9, -2.75573192e-7, 2.48015873e-5, -1.38888889e-3, 4.16666667e-2, -0.5, 1


def numpy_read(pixels: Pixels, light_e: np.ndarray, rows: slice, numbers: np.ndarray) -> None:
    """As `read`."""
    for plane, (plane_e, plane_numbers) in enumerate(zip(light_e, numbers, strict=True)):
        for row in range(*rows.indices(len(plane_e))):
            plane_numbers[row] = _read_row(pixels, plane_e[row], row, plane)


def _read_row(pixels, light_e, row, plane):
    full_e, gain = np.float32(pixels.full_e), np.float32(pixels.gain_dn_per_e)
    black = np.float32(pixels.black_dn)
    if pixels.noisy:
        place = pixels.place[0] + row, pixels.place[1] + np.arange(light_e.size), plane
        signal_e = _noisy(pixels, light_e, place)
    else:
        signal_e = np.fmin(_mean(pixels, light_e, np.float32(1)), full_e)
    return _rounded(np.clip(signal_e * gain + black, 0, np.float32(pixels.white_dn)))


def random_words(key: int, row: int, column: np.ndarray, plane: int, purpose: int) -> np.ndarray:
    """Threefry2x32-20: uint32 array (word, column)."""
    keys = [key & 0xFFFFFFFF, key >> 32 & 0xFFFFFFFF]
    keys.append(0x1BD11BDA ^ keys[0] ^ keys[1])
    first = (row << 16 | column).astype(np.uint32) + np.uint32(keys[0])
    second = np.zeros_like(first) + np.uint32(4 * plane + purpose + keys[1] & 0xFFFFFFFF)
    for turn in range(20):
        first = first + second
        left = np.uint32(TURNS[turn % 8])
        second = first ^ (second << left | second >> np.uint32(32) - left)
        if turn % 4 == 3:
            n = turn // 4 + 1
            first = first + np.uint32(keys[n % 3])
            second = second + np.uint32(keys[(n + 1) % 3] + n & 0xFFFFFFFF)
    return np.stack([first, second])


def _noisy(pixels, light_e, place):
    """Electrons that are read from pixels, with all that is random."""
    response, offset = _normals(*random_words(pixels.pixel_key, *place, DIFFERENCES))
    shot, reading = _normals(*random_words(pixels.noise_key, *place, NOISE))
    mean_e = _mean(pixels, light_e, 1 + np.float32(pixels.prnu) * response)
    few = mean_e < FEW_E
    counted = _many(np.maximum(mean_e, np.float32(FEW_E)), shot)
    counted[few] = _few(mean_e[few], random_words(pixels.noise_key, *place, COUNTS)[0][few])
    return (np.minimum(counted, np.float32(pixels.full_e)) + np.float32(pixels.dsnu_e) * offset
            + np.float32(pixels.noise_e) * reading)


def _mean(pixels, light_e, response):
    mean_e = light_e * np.maximum(response, 0) + np.float32(pixels.dark_e)
    return np.fmin(np.fmax(mean_e, np.float32(0)), np.float32(MOST_E))


def _normals(for_radius, for_angle):
    """Two independent normal numbers from two words, by Box and Muller."""
    share = (for_radius >> np.uint32(1)).view(np.int32).astype(np.float32) * np.float32(2**-31) + np.float32(2**-32)
    radius = np.sqrt(-2 * _logarithm(share))
    turns = for_angle.view(np.int32).astype(np.float32) * np.float32(2**-32)
    cosine, minus_sine = _turned(turns)
    return radius * cosine, radius * minus_sine


def _many(mean_e, normal):
    """Electrons counted for a normal number: the inverse of Poisson's distribution, by its asymptotic series."""
    deviation, square = np.sqrt(mean_e), normal * normal
    sixth = np.float32(1) / np.float32(6)
    count = mean_e + deviation * normal + (square + 2) * (sixth - normal / (72 * deviation))
    return _rounded(count - np.float32(0.5))


def _few(mean_e, word):
    """Electrons counted for a word: the inverse of Poisson's distribution, by its sum. For means below FEW_E."""
    mean, share = mean_e.astype(np.float64), (word.astype(np.float64) + 0.5) * 2.0**-32
    term = _exponential_of_few(-mean)
    total, count = term.copy(), np.zeros(mean.shape, np.float32)
    for n in range(1, MOST_COUNTED):
        above = share > total
        if not above.any():
            break
        count += above
        term = term * (mean * (1 / n))
        total += term
    return count


def _exponential_of_few(power):
    x = power / 64
    series = 1 + x / 12
    for n in range(11, 0, -1):
        series = 1 + x * (1 / n) * series
    for _ in range(6):
        series = series * series
    return series


def _polynomial(x, coefficients):
    """The first coefficient belongs to the highest power."""
    value = np.float32(coefficients[0])
    for coefficient in coefficients[1:]:
        value = np.float32(coefficient) + x * value
    return value


def _logarithm(a):
    bits = a.view(np.int32)
    twos = (bits - np.int32(0x3F3504F3)) >> 23
    x = (bits - (twos << 23)).view(np.float32) - np.float32(1)
    power, square = twos.astype(np.float32), x * x
    series = x * square * _polynomial(x, LOGARITHM) - np.float32(0.5) * square - power * np.float32(2.12194440e-4)
    return power * np.float32(0.693359375) + (x + series)


def _turned(waves):
    """Cosine and minus sine of waves between -1/2 and 1/2."""
    x = waves * np.float32(3.14159265)
    square = x * x
    sine, half = x * _polynomial(square, SINE), _polynomial(square, COSINE)
    return 1 - 2 * sine * sine, -2 * sine * half


def _rounded(a):
    return (a + WHOLE) - WHOLE
