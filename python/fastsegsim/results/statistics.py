"""Statistics of success rates: those of experiments/results/statistics.h, to the last digits of a table's JSON.

Symbols: k successes of n trials. Paired outcomes of two arms on the same episodes: both succeed, only the second
("after") does, only the first ("before") does, neither does.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fastsegsim import _statistics
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
    """A mean and its interval, at a confidence of 0.95."""

    mean: float
    low: float
    high: float


def check_between_0_and_1(value: float, name: str) -> None:
    if not 0.0 < value < 1.0:
        raise InputError(f"{name}: expected a number between 0 and 1, found {value}")


def _quantile(confidence: float) -> float:
    check_between_0_and_1(confidence, "confidence")
    return _statistics.normal_quantile(0.5 + 0.5 * confidence)


def _values(values: ArrayLike, name: str) -> list[float]:
    found = np.asarray(values, np.float64)
    if found.ndim != 1 or not np.all(np.isfinite(found)):
        raise InputError(f"{name}: expected a list of finite numbers, found {values!r}")
    return found.tolist()


def _check_draws(rounds: int, seed: int) -> None:
    if rounds < 1:
        raise InputError(f"rounds: expected at least 1, found {rounds}")
    if not 0 <= seed < 2**32:
        raise InputError(f"seed: expected 0 to {2**32 - 1}, found {seed}")


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


def clopper_pearson_interval(successes: int, trials: int, confidence: float = 0.95) -> Interval:
    """Clopper and Pearson's interval (1934) of a rate: it always covers at least `confidence`. [0, 1] for no trials."""
    check_between_0_and_1(confidence, "confidence")
    k, n = int(_counts(successes, "successes")), int(_counts(trials, "trials"))
    if k > n:
        raise InputError("successes: expected at most as many as trials, found more")
    return Interval(*_statistics.clopper_pearson_interval(k, n, confidence))


def _of_each_pair(test: Callable[[int, int], float], only_after: ArrayLike, only_before: ArrayLike) -> Numbers:
    b, c = np.broadcast_arrays(_counts(only_after, "only_after"), _counts(only_before, "only_before"))
    p = np.array([test(int(x), int(y)) for x, y in zip(b.ravel(), c.ravel())], np.float64)
    return p.reshape(b.shape)[()]


def mcnemar_exact_p(only_after: ArrayLike, only_before: ArrayLike) -> Numbers:
    """Exact two-sided McNemar test of the discordant pairs; 1 where there are none. Any shape; broadcast."""
    return _of_each_pair(_statistics.mcnemar_exact_p, only_after, only_before)


def mcnemar_mid_p(only_after: ArrayLike, only_before: ArrayLike) -> Numbers:
    """The same with half the probability of splits as uneven as the observed one (Fagerland et al. 2013)."""
    return _of_each_pair(_statistics.mcnemar_mid_p, only_after, only_before)


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
    _check_draws(rounds, seed)
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


def bootstrap_mean(values: ArrayLike, rounds: int = 10000, seed: int = 1) -> MeanInterval:
    """Mean of values [n], with the percentile bootstrap's interval (Efron 1979), which is too narrow for a handful.

    From 1000 values on it is its normal limit, and nothing is drawn. Zeros for no values.
    """
    _check_draws(rounds, seed)
    return MeanInterval(*_statistics.bootstrap_mean(_values(values, "values"), rounds, seed))


def sign_flip_p(differences: ArrayLike, rounds: int = 10000, seed: int = 1) -> float:
    """Two-sided sign-flip permutation test of a mean of 0. Exact up to 16 values; 1 for no values."""
    _check_draws(rounds, seed)
    return _statistics.sign_flip_p(_values(differences, "differences"), rounds, seed)


def holm_correction(p_values: ArrayLike) -> Numbers:
    """p-values [n] after Holm's correction (1979) for their number, in the order given."""
    p = _values(p_values, "p_values")
    if any(not 0.0 <= value <= 1.0 for value in p):
        raise InputError(f"p_values: expected numbers from 0 to 1, found {p_values!r}")
    return np.array(_statistics.holm_correction(p), np.float64)


def pairs_needed(discordant: float, difference: float, power: float = 0.8) -> int:
    """Pairs of trials that find a difference of two rates at the 5 % level, two-sided (Connor 1987).

    discordant: expected share of the pairs whose outcomes differ; at least as large as the difference.
    """
    check_between_0_and_1(power, "power")
    if not 0.0 < abs(difference) <= discordant <= 1.0:
        raise InputError(f"difference: expected 0 < |difference| <= discordant <= 1, found {difference}, {discordant}")
    return _statistics.pairs_needed(discordant, difference, power)


def verdict(counts: PairedCounts, p: float | None = None, difference: PairedDifference | None = None) -> str:
    """In one word: "improved", "worse", "underpowered", "held" or "unresolved" (docs/report.md).

    p, difference: of another test and interval than McNemar's exact one and Newcombe's.
    """
    a, b, c, d = (int(_counts(value, name)) for name, value in zip(counts._fields, counts))
    p = _statistics.mcnemar_exact_p(b, c) if p is None else p
    found = newcombe_paired_difference(counts) if difference is None else difference
    return _statistics.verdict(a, b, c, d, p, float(found.difference), *(float(end) for end in found.interval))
