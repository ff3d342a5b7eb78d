"""The numbers are those of tests/experiments/results/statistics_test.cpp, where their sources are named."""

import math

import numpy as np
import pytest

from fastsegsim import InputError
from fastsegsim.results import (PairedCounts, bootstrap_mean, clopper_pearson_interval, cluster_bootstrap_mean,
                                holm_correction, mcnemar_exact_p, mcnemar_mid_p, newcombe_paired_difference,
                                pairs_needed, sign_flip_p, verdict, wilson_interval)
from fastsegsim.results.random_stream import random_indices


@pytest.mark.parametrize("k, n, low, high", [
    (0, 10, 0, .2775), (9, 10, .5958, .9821), (5, 5, .5655, 1), (10, 20, .2993, .7007), (25, 100, .1755, .3430),
    (1050, 2000, .5031, .5468)])
def test_wilson_has_the_reference_values(k, n, low, high):
    np.testing.assert_allclose(wilson_interval(k, n), (low, high), atol=6e-5)


def test_wilson_to_all_digits_of_the_program():
    np.testing.assert_allclose(wilson_interval(25, 100, 0.9), (0.18599792395941464, 0.32717343643217256), rtol=1e-12)


def test_wilson_is_exact_at_the_ends_and_takes_arrays():
    n = np.arange(1, 61)
    assert np.all(wilson_interval(0, n).low == 0.0) and np.all(wilson_interval(n, n).high == 1.0)
    assert wilson_interval(0, 0) == (0.0, 1.0)
    k = np.arange(61)[:, None]
    k, of = np.broadcast_arrays(np.minimum(k, n), n)
    low, high = wilson_interval(k, of)
    assert low.shape == (61, 60)
    assert np.all((0 <= low) & (low <= k / of) & (k / of <= high) & (high <= 1))
    assert low[7, 29] == wilson_interval(7, 30).low


MCNEMAR = [(4, 0, .125, .0625, 1e-12), (5, 0, .0625, .03125, 1e-12), (6, 0, .03125, .015625, 1e-12),
           (8, 0, .0078125, .00390625, 1e-12), (6, 1, .125, .0703125, 1e-12), (10, 2, .03857, .02246, 6e-6),
           (15, 5, .04139, .02660, 6e-6), (12, 5, .14346, .09625, 6e-6), (30, 10, .002221, .001450, 6e-7),
           (1, 1, 1, .75, 1e-12), (3, 3, 1, .84375, 1e-12), (0, 0, 1, 1, 1e-12)]


def test_mcnemar_has_the_reference_values():
    b, c, exact, mid, tolerance = (np.array(column) for column in zip(*MCNEMAR))
    assert np.all(np.abs(mcnemar_exact_p(b, c) - exact) < tolerance)
    assert np.all(np.abs(mcnemar_mid_p(b, c) - mid) < tolerance)
    np.testing.assert_array_equal(mcnemar_exact_p(b, c), mcnemar_exact_p(c, b))
    # Of the program, to all digits.
    np.testing.assert_allclose(mcnemar_exact_p(700, 620), 0.029636429325377231, rtol=1e-9)
    np.testing.assert_allclose(mcnemar_mid_p(700, 620), 0.027691566720303186, rtol=1e-9)


def test_mcnemar_agrees_with_counting_all_outcomes():
    for n in range(1, 13):
        unevenness = [abs(2 * i - n) for i in range(n + 1)]
        ways = [math.comb(n, i) for i in range(n + 1)]
        for b in range(n + 1):
            more = sum(w for w, u in zip(ways, unevenness) if u > unevenness[b])
            equal = sum(w for w, u in zip(ways, unevenness) if u == unevenness[b])
            assert mcnemar_exact_p(b, n - b) == pytest.approx((more + equal) / 2**n, abs=1e-12)
            assert mcnemar_mid_p(b, n - b) == pytest.approx((more + 0.5 * equal) / 2**n, abs=1e-12)


NEWCOMBE = [((1, 4, 0, 0), .80, .1926, .9638), ((1, 1, 0, 2), .25, -.3196, .6553), ((5, 5, 0, 10), .25, .0319, .4337),
            ((20, 15, 5, 60), .10, .0120, .1866), ((2, 8, 0, 0), .80, .3840, .9433)]


def test_newcombe_has_the_reference_values():
    for counts, difference, low, high in NEWCOMBE:
        found = newcombe_paired_difference(PairedCounts(*counts))
        assert found.difference == pytest.approx(difference, abs=1e-12)
        np.testing.assert_allclose(found.interval, (low, high), atol=6e-5)
    found = newcombe_paired_difference(PairedCounts(20, 15, 5, 60), 0.9)
    np.testing.assert_allclose(found.interval, (0.026125274630017389, 0.17283746979387199), rtol=1e-11)


def test_newcombe_takes_arrays_and_no_pairs():
    columns = PairedCounts(*(np.array([counts[k] for counts, *_ in NEWCOMBE]) for k in range(4)))
    found = newcombe_paired_difference(columns)
    for k, (counts, *_) in enumerate(NEWCOMBE):
        one = newcombe_paired_difference(PairedCounts(*counts))
        assert (found.difference[k], found.interval.low[k], found.interval.high[k]) == (one.difference, *one.interval)
    none = newcombe_paired_difference(PairedCounts(0, 0, 0, 0))
    assert (none.difference, *none.interval) == (0.0, -1.0, 1.0)


def test_swapping_the_arms_mirrors_the_difference():
    random = np.random.default_rng(1)
    a, b, c, d = random.integers(0, 20, (4, 50))
    one = newcombe_paired_difference(PairedCounts(a, b, c, d + 1)).interval
    other = newcombe_paired_difference(PairedCounts(a, c, b, d + 1)).interval
    np.testing.assert_allclose(one.low, -other.high, atol=1e-12)
    np.testing.assert_allclose(one.high, -other.low, atol=1e-12)


def test_random_numbers_are_those_of_the_program():
    # core::RandomStream(7, "cluster_bootstrap").index(1000), ten times.
    drawn = random_indices(7, "cluster_bootstrap", 10, 1000).tolist()
    assert drawn == [497, 309, 180, 211, 324, 405, 793, 573, 284, 961]


def test_cluster_bootstrap_draws_as_the_program_does():
    sums, counts = [7.0, 12.0, 3.5, 18.0, 9.0, 1.0], [20, 25, 30, 20, 15, 10]
    expected = (0.42083333333333334, 0.2103448275862069, 0.66666666666666663)
    np.testing.assert_allclose(cluster_bootstrap_mean(sums, counts), expected, rtol=1e-12)
    other = (0.42083333333333334, 0.21739130434782608, 0.68181818181818177)
    np.testing.assert_allclose(cluster_bootstrap_mean(sums, counts, 999, 7), other, rtol=1e-12)


def test_cluster_bootstrap_sees_the_scenes_not_the_episodes():
    found = cluster_bootstrap_mean([0.0, 50.0, 0.0, 100.0], [100, 100, 0, 100])
    np.testing.assert_allclose(found, (0.5, 0.0, 1.0), atol=1e-12)
    assert cluster_bootstrap_mean([30.0, 0.0], [30, 10]).mean == 0.75
    assert cluster_bootstrap_mean([], []) == (0.0, 0.0, 0.0)


def test_what_the_program_computes_has_the_reference_values():
    np.testing.assert_allclose(clopper_pearson_interval(0, 10), (0.0, 1 - 0.025**0.1), rtol=1e-12)
    assert clopper_pearson_interval(0, 0) == (0.0, 1.0)
    assert pairs_needed(.30, .10) == 234 and pairs_needed(.30, .10, .9) == 312
    np.testing.assert_allclose(holm_correction([.04, .01, .03]), [.06, .03, .06], rtol=1e-12)
    assert sign_flip_p([1, 2, 3]) == 2 / 8 and sign_flip_p([]) == 1.0
    assert bootstrap_mean([0, 1]) == (0.5, 0.0, 1.0) and bootstrap_mean([0.25]) == (0.25, 0.25, 0.25)
    found = {counts: verdict(PairedCounts(*counts)) for counts in
             [(5, 8, 0, 3), (5, 0, 8, 3), (2, 2, 1, 5), (20, 12, 5, 20), (200, 2, 2, 200)]}
    assert list(found.values()) == ["improved", "worse", "underpowered", "unresolved", "held"]
    assert verdict(PairedCounts(5, 8, 0, 3), p=0.5) == "unresolved"


def test_what_is_no_count_is_refused():
    for call in (lambda: wilson_interval(3, 2), lambda: wilson_interval(-1, 2), lambda: wilson_interval(1, 2, 1.0),
                 lambda: mcnemar_exact_p(-1, 2), lambda: mcnemar_mid_p(0.5, 2),
                 lambda: newcombe_paired_difference(PairedCounts(1, -1, 0, 0)),
                 lambda: cluster_bootstrap_mean([1.0], [1, 2]), lambda: cluster_bootstrap_mean([1.0], [1], rounds=0),
                 lambda: clopper_pearson_interval(3, 2), lambda: clopper_pearson_interval(1, 2, 0.0),
                 lambda: holm_correction([1.5]), lambda: sign_flip_p([math.nan]), lambda: bootstrap_mean([1], seed=-1),
                 lambda: pairs_needed(.1, .2), lambda: pairs_needed(.3, .1, 1.0),
                 lambda: verdict(PairedCounts(1, -1, 0, 0))):
        with pytest.raises(InputError):
            call()
