"""Results of runs: trials as arrays, and the statistics of `segsim table` as functions of NumPy arrays."""

from fastsegsim.results.statistics import (Interval, MeanInterval, PairedCounts, PairedDifference,
                                           cluster_bootstrap_mean, mcnemar_exact_p, mcnemar_mid_p,
                                           newcombe_paired_difference, wilson_interval)
from fastsegsim.results.stored_run import Run, load_run

__all__ = ["Interval", "MeanInterval", "PairedCounts", "PairedDifference", "Run", "cluster_bootstrap_mean", "load_run",
           "mcnemar_exact_p", "mcnemar_mid_p", "newcombe_paired_difference", "wilson_interval"]
