"""Results of runs: trials as arrays and tables, and the statistics of `segsim table` as functions.

`fastsegsim.results("out/flat")` is short for `fastsegsim.results.load_run("out/flat")`.
"""
import sys
import types

from fastsegsim.results.lerobot_export import LeRobotSet, export_lerobot
from fastsegsim.results.statistics import (Interval, MeanInterval, PairedCounts, PairedDifference, bootstrap_mean,
                                           clopper_pearson_interval, cluster_bootstrap_mean, holm_correction,
                                           mcnemar_exact_p, mcnemar_mid_p, newcombe_paired_difference, pairs_needed,
                                           sign_flip_p, verdict, wilson_interval)
from fastsegsim.results.stored_run import Run, load_run, paired_counts
from fastsegsim.results.training_statistics import (SeededValues, TrainingTest, hierarchical_interval,
                                                    hierarchical_rate_interval, training_test)

__all__ = ["Interval", "LeRobotSet", "MeanInterval", "PairedCounts", "PairedDifference", "Run", "SeededValues",
           "TrainingTest", "bootstrap_mean", "clopper_pearson_interval", "cluster_bootstrap_mean", "export_lerobot",
           "hierarchical_interval", "hierarchical_rate_interval", "holm_correction", "load_run", "mcnemar_exact_p",
           "mcnemar_mid_p", "newcombe_paired_difference", "paired_counts", "pairs_needed", "sign_flip_p",
           "training_test", "verdict", "wilson_interval"]


class _Results(types.ModuleType):
    """This module, which may be called."""

    def __call__(self, path, run_id=0):
        return load_run(path, run_id)


sys.modules[__name__].__class__ = _Results
