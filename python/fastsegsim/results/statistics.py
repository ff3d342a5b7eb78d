"""Statistics of success rates: those of experiments/results/statistics.h, to about 1e-9.

Symbols: k successes of n trials. Paired outcomes of two arms on the same episodes: both succeed, only the second
("after") does, only the first ("before") does, neither does.
"""

import math
from collections.abc import Callable
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fastsegsim._native import InputError
from fastsegsim.results.random_stream import random_indices

Numbers = NDArray[np.float64]


class Interval(NamedTuple):
    """Arrays of the shape of the input, or numbers."""

    low: Numbers
    high: Numbers


class PairedCounts(NamedTuple):
    """Episodes by the outcomes of two arms; numbers, or arrays of one shape."""

    both: ArrayLike
    only_after: ArrayLike
    only_before: ArrayLike
    neither: ArrayLike


class PairedDifference(NamedTuple):
    """Rate after - rate before, in [-1, 1]."""

    difference: Numbers
    interval: Interval


class MeanInterval(NamedTuple):
    """A mean with an interval of 95 %."""

    mean: float
    low: float
    high: float


def _quantile(confidence: float) -> float:
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence: expected a number between 0 and 1, found {confidence}")
    return NormalDist().inv_cdf(0.5 + 0.5 * confidence)


def _counts(values: ArrayLike, name: str) -> Numbers:
    counts = np.asarray(values, np.float64)
    if not np.all((counts >= 0) & (counts == np.floor(counts))):
        raise InputError(f"{name}: expected whole numbers of at least 0, found {values!r}")
    return counts


def wilson_interval(successes: ArrayLike, trials: ArrayLike, confidence: float = 0.95) -> Interval:
    """Wilson's score interval (1927) of a rate; [0, 1] for no trials. Any shape; the two are broadcast."""
    k, n = np.broadcast_arrays(_counts(successes, "successes"), _counts(trials, "trials"))
    if np.any(k > n):
        raise InputError("successes: expected at most as many as trials, found more")
    z = _quantile(confidence)
    some = np.maximum(n, 1.0)
    rate = k / some
    centre = (rate + z * z / (2.0 * some)) / (1.0 + z * z / some)
    half = z / (1.0 + z * z / some) * np.sqrt(rate * (1.0 - rate) / some + z * z / (4.0 * some * some))
    # The ends are exact at 0 and 1; rounding must not push them past.
    low = np.where((k == 0) | (n == 0), 0.0, np.maximum(0.0, centre - half))
    high = np.where((k == n) | (n == 0), 1.0, np.minimum(1.0, centre + half))
    return Interval(low[()], high[()])


def _binomial_half(n: int, k: int) -> float:
    """C(n, k) / 2^n."""
    return math.exp(math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1) - n * math.log(2.0))


def _exact_p(only_after: int, only_before: int) -> float:
    n = only_after + only_before
    return min(1.0, 2.0 * sum(_binomial_half(n, i) for i in range(min(only_after, only_before) + 1)))


def _mid_p(only_after: int, only_before: int) -> float:
    n = only_after + only_before
    if n == 0:
        return 1.0
    observed = _binomial_half(n, min(only_after, only_before))
    # An uneven split has a mirror image that is as uneven; the even one stands alone.
    as_uneven = observed if only_after == only_before else 2.0 * observed
    return _exact_p(only_after, only_before) - 0.5 * as_uneven


def _of_each_pair(test: Callable[[int, int], float], only_after: ArrayLike, only_before: ArrayLike) -> Numbers:
    b, c = np.broadcast_arrays(_counts(only_after, "only_after"), _counts(only_before, "only_before"))
    p = np.array([test(int(x), int(y)) for x, y in zip(b.ravel(), c.ravel())], np.float64)
    return p.reshape(b.shape)[()]


def mcnemar_exact_p(only_after: ArrayLike, only_before: ArrayLike) -> Numbers:
    """Exact two-sided McNemar test of the discordant pairs; 1 where there are none. Any shape; broadcast."""
    return _of_each_pair(_exact_p, only_after, only_before)


def mcnemar_mid_p(only_after: ArrayLike, only_before: ArrayLike) -> Numbers:
    """The same with half the probability of splits as uneven as the observed one (Fagerland et al. 2013)."""
    return _of_each_pair(_mid_p, only_after, only_before)


def newcombe_paired_difference(counts: PairedCounts, confidence: float = 0.95) -> PairedDifference:
    """Difference of two paired rates, with Newcombe's score interval (1998, method 10); [-1, 1] without pairs."""
    a, b, c, d = np.broadcast_arrays(*(_counts(value, name) for name, value in zip(counts._fields, counts)))
    n = a + b + c + d
    some = np.maximum(n, 1.0)
    after, before = (a + b) / some, (a + c) / some
    low_after, high_after = wilson_interval(a + b, n, confidence)
    low_before, high_before = wilson_interval(a + c, n, confidence)

    # Correlation of the two outcomes, phi, with Newcombe's continuity correction.
    product = (a + b) * (c + d) * (a + c) * (b + d)
    covariance = a * d - b * c
    corrected = np.where(covariance > 0.0, np.maximum(covariance - n / 2.0, 0.0), covariance)
    phi = np.where(product > 0.0, corrected / np.sqrt(np.where(product > 0.0, product, 1.0)), 0.0)

    def half_width(of_after: Numbers, of_before: Numbers) -> Numbers:
        return np.sqrt(np.maximum(0.0, of_after**2 - 2.0 * phi * of_after * of_before + of_before**2))

    difference = after - before
    low = difference - half_width(after - low_after, high_before - before)
    high = difference + half_width(high_after - after, before - low_before)
    return PairedDifference(difference[()], Interval(np.where(n > 0, low, -1.0)[()], np.where(n > 0, high, 1.0)[()]))


def cluster_bootstrap_mean(sums: ArrayLike, counts: ArrayLike, rounds: int = 10000, seed: int = 1) -> MeanInterval:
    """Mean over all values, with an interval from drawing whole clusters (scenes) with replacement.

    sums, counts: [clusters], the values of each cluster as their sum and number; those without values are left out.
    It says little for fewer than five clusters. Equal arguments give the numbers of the C++ program: the draws are
    the same. Zeros for no values.
    """
    total, count = np.asarray(sums, np.float64), _counts(counts, "counts")
    if total.ndim != 1 or total.shape != count.shape:
        raise InputError(f"sums, counts: expected two arrays of one length, found {total.shape} and {count.shape}")
    if rounds < 1:
        raise InputError(f"rounds: expected at least 1, found {rounds}")
    total, count = total[count > 0], count[count > 0]
    used = len(total)
    if used == 0:
        return MeanInterval(0.0, 0.0, 0.0)
    drawn = random_indices(seed, "cluster_bootstrap", rounds * used, used).reshape(rounds, used)
    drawn_sum, drawn_count = np.zeros(rounds), np.zeros(rounds)
    for clusters in drawn.T:  # In the order of the draws, so that sums are rounded alike.
        drawn_sum += total[clusters]
        drawn_count += count[clusters]
    means = np.sort(drawn_sum / drawn_count)
    tail = int(0.025 * rounds)
    return MeanInterval(float(sum(total.tolist()) / count.sum()), float(means[tail]), float(means[rounds - 1 - tail]))
