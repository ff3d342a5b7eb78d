"""Intervals and tests over several fine-tunings: those of experiments/results/training_statistics.h, to the last bit.

docs/metrics.md, "Intervals and tests with several trainings", has the formulas and what was measured.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from fastsegsim import _statistics
from fastsegsim._native import InputError
from fastsegsim.results.statistics import MeanInterval, check_between_0_and_1


@dataclasses.dataclass(frozen=True)
class SeededValues:
    """Values, successes (0 or 1) or differences after - before, and where each belongs; all of one length.

    Each place may occur once. Trainings are numbered within their reconstruction, episodes within their scene: the same
    episode has the same number under every training.
    """

    reconstruction: Sequence[int]
    training: Sequence[int]
    scene: Sequence[int]
    episode: Sequence[int]
    value: Sequence[float]

    def _columns(self) -> list[list]:
        places = (self.reconstruction, self.training, self.scene, self.episode)
        columns: list[list] = [[int(x) for x in column] for column in places]
        columns.append([float(x) for x in self.value])
        lengths = [len(column) for column in columns]
        if len(set(lengths)) > 1:
            raise InputError(f"SeededValues: expected columns of one length, found {lengths}")
        if len(set(zip(*columns[:4]))) != lengths[0]:
            raise InputError("SeededValues: expected one value for each place, found several")
        return columns


class TrainingTest(NamedTuple):
    """Is the mean over trainings and episodes 0?"""

    p: float  # Two-sided.
    degrees_of_freedom: float  # 0 where there was nothing to test.
    training_sd: float  # Between trainings, without the chance of a single trial.
    episode_sd: float


def hierarchical_interval(differences: SeededValues, confidence: float = 0.95) -> MeanInterval:
    """Mean of differences with a Student interval over reconstructions, trainings, scenes and episodes.

    Its variance is that of a hierarchical bootstrap, in closed form: nothing is drawn. Scenes are draws from five on.
    With one training it is the interval of the episodes alone. Not cut off at -1 and 1. Zeros for no values.
    """
    check_between_0_and_1(confidence, "confidence")
    return MeanInterval(*_statistics.hierarchical_interval(*differences._columns(), confidence))


def hierarchical_rate_interval(successes: SeededValues, confidence: float = 0.95) -> MeanInterval:
    """The same for successes: Wilson's interval for the number of independent trials that the values are worth."""
    check_between_0_and_1(confidence, "confidence")
    return MeanInterval(*_statistics.hierarchical_rate_interval(*successes._columns(), confidence))


def training_test(differences: SeededValues) -> TrainingTest:
    """Two-sided test of a mean of 0 over trainings and episodes, both as random effects.

    One training says nothing of training: p is then 1 with 0 degrees of freedom; take mcnemar_exact_p().
    """
    return TrainingTest(*_statistics.training_test(*differences._columns()))
