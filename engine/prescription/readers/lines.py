"""Lines of words and numbers in other programs' prescriptions, with their places for error messages."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from ...runtime.errors import LensError


class Line(NamedTuple):
    """The words of a line, its file, and the name of its place there."""

    path: Path
    place: str
    words: tuple[str, ...]

    def figure(self, index: int, default: float | None = None) -> float:
        """The number at this index among the words, or the default, if any, beyond the end of the line.

        Raises
        ------
        LensError
            The word is not a number, or missing.
        """
        if index >= len(self.words) and default is not None:
            return default
        try:
            return float(self.words[index])
        except (ValueError, IndexError):
            raise self.refusal(f"expected a number as word {index + 1}") from None

    def figures(self, first: int = 1) -> list[float]:
        """All numbers from the word `first` on."""
        return [self.figure(index) for index in range(first, len(self.words))]

    def refusal(self, remedy: str) -> LensError:
        """An error that quotes the line."""
        return LensError(self.path, self.place, " ".join(filter(None, self.words)), remedy)


def numbered(path: Path, lines: Iterable[str], separator: str | None = None) -> Iterator[Line]:
    """Lines that are not blank, numbered from 1."""
    for number, line in enumerate(lines, 1):
        words = tuple(line.split(separator))
        if any(map(str.strip, words)):
            yield Line(path, f"line {number}", words)
