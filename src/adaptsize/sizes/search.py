"""The search for a number: the factor by which sizes must change to have so many elements."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from adaptsize.sizes import tuning

T = TypeVar("T")

#: Stands for the logarithm of zero.
_NOTHING = -700.0
#: Bound on the logarithm of a scale whose bound is not known.
_FARTHEST = 40.0
#: Tolerance of the logarithms of the scale, and of the value unless another one is given.
ACCURACY_OF_SCALE = 2e-4


@dataclass(frozen=True)
class Trial(Generic[T]):
    """Sizes that were tried, or a mesh made with them."""

    factor: float
    """Of the sizes, over those of factor 1."""
    predicted: float
    """Number that is predicted for the sizes."""
    result: T
    made: float | None = None
    """Number that the mesh has, if one was made."""

    @property
    def number(self) -> float:
        """The number that counts: the one made, or else the predicted one."""
        return self.predicted if self.made is None else self.made

    def __str__(self) -> str:
        """Return the numbers."""
        if self.made is None:
            return f"{self.predicted:.0f} predicted with sizes times {self.factor:.3g}"
        return f"{self.made:.0f} where {self.predicted:.0f} were predicted"


@dataclass
class Search(Generic[T]):
    """A search for the factor of the sizes with which a number is the wanted one.

    The number falls about as the factor to the power ``-order``.  The caller takes the next
    ``factor``, computes sizes or makes a mesh, and adds the number.  At the end of the search,
    ``factor`` is None.  In logarithms, steps are secants.  Once a number above and one below are
    known, they stay between these, and interpolate or halve where a secant leads elsewhere.
    """

    wanted: float
    order: float
    above: float
    """Logarithm of the largest accepted number over the wanted one."""
    below: float | None = None
    """The same of the wanted number over the smallest accepted one; by default as ``above``."""
    most: int = 40
    """Largest number of trials."""
    start: float = 1.0
    """First factor."""
    bounds: tuple[float, float] = (0.0, math.inf)
    """Factors beyond which the sizes no longer change."""
    is_cap: bool = False
    """Whether a number above the accepted ones is worse than any below."""
    reach: float = 1.5
    """Logarithm of the largest step without a bracket."""
    patience: int = 1
    """Steps that change the number little, after which the bound is tried, or the search ends."""
    trust: float = 1.0
    """Share of the difference between the measured and the expected order that is believed."""
    resolution: float = 0.0
    """Logarithm of the width of a bracket that need not be divided."""
    trials: list[Trial[T]] = field(default_factory=list)

    def __post_init__(self) -> None:
        # Logarithms of the factors over the first one, and of the numbers over the wanted one.
        self._x: list[float] = []
        self._y: list[float] = []
        self._widths: list[float] = []
        self._next: float | None = 0.0
        self._expected: float | None = None

    @classmethod
    def by_meshes(
        cls, wanted: float, cell_dim: int, accepted: float | None = None, most: int = 3
    ) -> Search[T]:
        """Return the search for a number that meshes have, within a share of the wanted one."""
        accepted = tuning.ACCEPTED if accepted is None else accepted
        above, below = math.log1p(accepted), -math.log1p(-accepted)
        return cls(wanted, float(cell_dim), above, below, most=most, trust=tuning.TRUST)

    @property
    def factor(self) -> float | None:
        """The factor to be tried next; None at the end of the search."""
        if self._next is None:
            return None
        for bound in self.bounds:
            if 0.0 < bound < math.inf and self._next == math.log(bound / self.start):
                return bound
        return self.start * math.exp(self._next)

    def add(
        self, predicted: float, result: T, made: float | None = None, factor: float | None = None
    ) -> None:
        """Add a trial: of the last ``factor``, or of another one, which the sizes have instead."""
        if factor is not None:
            x = math.log(factor / self.start)
        elif self._next is not None:
            x = self._next
        else:
            raise ValueError("factor must be given after the end of the search")
        trial = Trial(self.start * math.exp(x), predicted, result, made)
        self.trials.append(trial)
        self._x.append(x)
        ratio = trial.number / self.wanted
        y = math.log(ratio) if ratio > 0.0 else _NOTHING
        self._y.append(min(max(y, _NOTHING), -_NOTHING))
        self._expected = None
        self._next = self._following()

    def expect(self, predicted: float) -> None:
        """Correct the next factor by the number that is predicted for it."""
        if self._next is None or self._next == self._x[-1] or not 0.0 < predicted < math.inf:
            return
        fall = self._y[-1] - math.log(predicted / self.wanted)
        self._expected = fall / (self._next - self._x[-1])
        self._next = self._following()

    def is_about(self, number: float) -> bool:
        """Whether a number is about the wanted one."""
        return number > 0.0 and abs(math.log(number / self.wanted)) <= tuning.ABOUT_THE_NUMBER

    def for_other(self, wanted: float) -> Search[T]:
        """Return the search for another number, which begins with the last trial."""
        other, last = replace(self, wanted=wanted, trials=[]), self.trials[-1]
        other.add(last.predicted, last.result, last.made, last.factor)
        other._expected = self._expected
        other._next = other._following()
        return other

    @property
    def best(self) -> Trial[T]:
        """The trial whose number is the nearest to the wanted one; of a cap, at most that."""
        return self.trials[self._best]

    @property
    def miss(self) -> float:
        """Logarithm of the best number over the wanted one."""
        return self._y[self._best]

    @property
    def _best(self) -> int:
        within = [i for i, y in enumerate(self._y) if y <= self.above] if self.is_cap else []
        # Of equal numbers, that with the factor nearest to the first one.
        return min(within or range(len(self._y)), key=lambda i: (abs(self._y[i]), abs(self._x[i])))

    @property
    def records(self) -> str:
        """The numbers of all trials."""
        return ", ".join(map(str, self.trials))

    def is_met(self, y: float) -> bool:
        """Whether a logarithm of a number over the wanted one is accepted."""
        return -(self.above if self.below is None else self.below) <= y <= self.above

    def _following(self) -> float | None:
        """Return the logarithm of the next factor over the first one."""
        x, y = self._x[-1], self._y[-1]
        if self.is_met(y) or len(self._x) >= self.most:
            return None
        bracket = self._bracket()
        slope = self._slope()
        low, high = tuning.LEAST_ORDER * self.order, tuning.LARGEST_ORDER * self.order
        if bracket is not None:
            is_secant = self.trust == 1.0 and low < slope < high
            return self._inside(bracket, x + y / slope if is_secant else math.nan)
        bound = self._bound(y)
        if x == bound:
            return None
        if self._is_flat():
            return bound if math.isfinite(bound) else None
        step = min(max(y / min(max(slope, low), high), -self.reach), self.reach)
        return min(x + step, bound) if y > 0.0 else max(x + step, bound)

    def _slope(self) -> float:
        """Return the order that is expected, or that of the last two trials as far as trusted."""
        if self._expected is not None:
            return self._expected
        if len(self._x) < 2 or self._x[-1] == self._x[-2]:
            return self.order
        measured = (self._y[-2] - self._y[-1]) / (self._x[-1] - self._x[-2])
        return self.order + self.trust * (measured - self.order)

    def _is_flat(self) -> bool:
        """Whether the last steps have hardly changed the number."""
        n = self.patience + 1
        if len(self._x) < n:
            return False
        steps = zip(self._x[-n:], self._x[1 - n :], self._y[-n:], self._y[1 - n :], strict=False)
        return all(abs(d - c) < tuning.FLAT_ORDER * self.order * abs(b - a) for a, b, c, d in steps)

    def _bound(self, y: float) -> float:
        """Return the farthest logarithm of a factor to the side of the wanted number."""
        bound = self.bounds[1] if y > 0.0 else self.bounds[0]
        sign = math.copysign(1.0, y)
        return math.log(bound / self.start) if 0.0 < bound < math.inf else sign * math.inf

    def _bracket(self) -> tuple[int, int] | None:
        """Return the nearest factors with numbers above and below, if they are in order."""
        above = [i for i, y in enumerate(self._y) if y > 0.0]
        below = [i for i, y in enumerate(self._y) if y <= 0.0]
        if not above or not below:
            return None
        low = max(above, key=lambda i: self._x[i])
        high = min(below, key=lambda i: self._x[i])
        return (low, high) if self._x[low] < self._x[high] else None

    def _inside(self, bracket: tuple[int, int], guess: float) -> float | None:
        """Return a place in a bracket: the guess, or that of an interpolation, or the middle."""
        (a, b), (c, d) = ([values[i] for i in bracket] for values in (self._x, self._y))
        self._widths.append(b - a)
        if b - a <= self.resolution or b - a <= 4e-16 * max(abs(a), abs(b)):
            return None
        before = self._widths[-1 - tuning.STALLED :]
        if len(before) > tuning.STALLED and b - a > 0.5 * before[0]:
            return 0.5 * (a + b)
        if a < guess < b:
            return guess
        away = tuning.INSIDE_BRACKET
        return a + (b - a) * min(max(c / (c - d), away), 1.0 - away)


def scale_to(
    wanted: float,
    make: Callable[[float], T],
    value: Callable[[T], float],
    start: float,
    order: float,
    accuracy: float = ACCURACY_OF_SCALE,
    *,
    bounds: tuple[float, float] = (0.0, math.inf),
    most: int = 60,
) -> T:
    """Return the sizes whose value is as wanted, or nearest to it.

    Parameters
    ----------
    wanted : float
        Positive.
    make : callable
        Returns the sizes of a positive scale.  It may limit the gradient on the whole mesh.
    value : callable
        Returns the value of sizes: non-increasing with the scale; may be bounded on either side.
    start : float
        Positive scale, near the result.
    order : float
        The value falls about as the scale to this power.
    accuracy : float
        Logarithm of the value over the wanted one that is accepted.
    bounds : (float, float)
        The sizes are the same for all scales below the first, and above the second.
    most : int
        Largest number of scales tried.

    Returns
    -------
    object
        What ``make`` returned.  If ``wanted`` is beyond a bound, ``value`` is at its bound.
    """
    search: Search[T] = search_of_scale(wanted, order, start, accuracy, bounds, most)
    while (factor := search.factor) is not None:
        made = make(factor)
        search.add(value(made), made)
    return search.best.result


def search_of_scale(
    wanted: float,
    order: float,
    start: float,
    accuracy: float,
    bounds: tuple[float, float],
    most: int = 60,
) -> Search[T]:
    """Return the search for the scale of sizes whose value is as wanted; see `scale_to`."""
    low, high = bounds
    far = math.exp(_FARTHEST)
    return Search(
        wanted, order, accuracy, most=most, start=start, reach=3.0, resolution=ACCURACY_OF_SCALE,
        bounds=(low or start / far, high if math.isfinite(high) else start * far),
    )  # fmt: skip


def smallest_tolerance(
    tolerance: float, load: float, load_of: Callable[[float], float]
) -> float | None:
    """Return the smallest tolerance, in two digits, with which a number is small enough.

    Parameters
    ----------
    tolerance : float
        One that is too small, over the diameter.
    load : float
        The number with it over the allowed one, above 1.
    load_of : callable
        Returns the same for another tolerance.  It falls with about the power -1.2 of that.

    Returns
    -------
    float or None
        None if no tolerance within which a mesh has the shape of the domain is enough.
    """
    if tolerance >= tuning.LARGEST_TOLERANCE:
        return None
    search: Search[float] = Search(
        1.0, 1.2, tuning.ENOUGH, below=0.1, start=tolerance, is_cap=True, resolution=math.log(1.1),
        bounds=(tolerance, tuning.LARGEST_TOLERANCE),
    )  # fmt: skip
    search.add(load, tolerance)
    while (factor := search.factor) is not None:
        search.add(load_of(factor), factor)
    if search.miss > tuning.ENOUGH:
        return None
    offer = rounded_up(search.best.factor)
    while load_of(offer) > math.exp(tuning.ENOUGH):  # the number falls up to a few per cent
        offer = rounded_up(1.05 * offer)
    return offer


def rounded_up(value: float) -> float:
    """Return the next number of two digits.

    Examples
    --------
    >>> rounded_up(0.00312), rounded_up(0.0031), rounded_up(451.0)
    (0.0032, 0.0031, 460.0)
    """
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit - 1e-9) * unit:.2g}")
