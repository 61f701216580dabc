"""The two ways to the best values, as functions of a score; neither knows what it is scored on."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vsr2.calibration.calibration_study import (
    CALIBRATION,
    CalibrationParameter,
    Joint,
    Sequential,
    at_share,
    share_of,
    within,
)
from vsr2.calibration.evaluation import Evaluate
from vsr2.calibration.evaluation_store import Evaluation
from vsr2.config.extended import Plain

Score = Callable[[Evaluation], float]
Parameters = Mapping[str, CalibrationParameter]


@dataclass(frozen=True, eq=False)
class Step:
    """One parameter set that a search looked at.

    Attributes:
        iteration: of the sequential procedure, from 1; 0: before it, or the joint search.
        group: the parameter that was varied, or "start", "design", "refine", "profile".
        evaluation: values and predictions.
        score: by what the search maximises.
    """

    iteration: int
    group: str
    evaluation: Evaluation
    score: float


def best_step(steps: Sequence[Step]) -> Step:
    """The step of the highest score, the first of equals."""
    return max(steps, key=lambda step: step.score)


def sequential_search(
    parameters: Parameters,
    start: Mapping[str, Plain],
    evaluate: Evaluate,
    score: Score,
    method: Sequential,
) -> list[Step]:
    """The supplement's procedure (S3).

    Over the parameters in turn, each of a parameter's values is tried with the others at their best
    so far; the best is carried forward if it is better than what was. Iterations over all
    parameters end when one brings no more than `min_gain`.

    Returns:
        All steps in order; the first is of the start values.
    """
    evaluation = evaluate(start)
    best = Step(0, "start", evaluation, score(evaluation))
    steps = [best]
    for iteration in range(1, method.max_iterations + 1):
        before = best.score
        for name, parameter in parameters.items():
            assert parameter.values is not None
            # Fixed for this parameter's sweep, as in the supplement's table.
            carried = dict(best.evaluation.values)
            for value in parameter.values:
                evaluation = evaluate(carried | {name: value})
                step = Step(iteration, name, evaluation, score(evaluation))
                steps.append(step)
                if step.score > best.score:
                    best = step
        if best.score - before <= method.min_gain:
            break
    return steps


def spread_points(count: int, dimensions: int, seed: int) -> np.ndarray[Any, Any]:
    """Points that fill the unit cube evenly, (count, d): a scrambled Sobol sequence (Owen 1998).

    More points begin with the fewer.
    """
    from scipy.stats import qmc

    # Of a power of two, as the sequence is balanced then.
    sequence = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed))
    points = sequence.random_base2(max(count - 1, 0).bit_length())[:count]
    return np.asarray(points, dtype=np.float64)


def design_values(
    parameters: Parameters, start: Mapping[str, Plain], count: int, seed: int
) -> list[dict[str, Plain]]:
    """The joint search's first sets: the study's own where it lies within, then spread points."""
    sets: list[dict[str, Plain]] = []
    if all(within(parameters[name], value) for name, value in start.items()):
        sets.append(dict(start))
    cube = spread_points(count - len(sets), len(parameters), seed)
    for point in cube:
        sets.append(
            {
                name: at_share(parameter, float(share))
                for (name, parameter), share in zip(parameters.items(), point, strict=True)
            }
        )
    return sets


def joint_search(
    parameters: Parameters,
    design: Sequence[Evaluation],
    evaluate: Evaluate,
    score: Score,
    method: Joint,
    seed: int,
) -> list[Step]:
    """A design, then sets that an estimator or an evolution strategy proposes.

    Ranges are searched by their share, so that all have one scale
    (:func:`vsr2.calibration.calibration_study.at_share`).

    Args:
        parameters: what is varied.
        design: evaluations of :func:`design_values`.
        evaluate: gives further evaluations.
        score: what is maximised.
        method: how, and how many.
        seed: of the proposals. Same seed, same scores: same steps.

    Returns:
        The design, then what was added.
    """
    steps = [Step(0, "design", one, score(one)) for one in design]

    def step(coordinates: Mapping[str, Any]) -> float:
        evaluation = evaluate(_values(parameters, coordinates))
        steps.append(Step(0, "refine", evaluation, score(evaluation)))
        return steps[-1].score

    if method.refine:
        propose = _by_evolution if method.proposals == "cma" else _by_estimator
        propose(parameters, tuple(steps), step, method.refine, seed)
    return steps


def _by_estimator(
    parameters: Parameters,
    design: Sequence[Step],
    step: Callable[[Mapping[str, Any]], float],
    count: int,
    seed: int,
) -> None:
    """A multivariate tree-structured Parzen estimator, begun from a design.

    Bergstra et al. (2011), as optuna's `TPESampler` has it: it takes steps in the objective, words
    among the parameters and ridges between them, and a few hundred evaluations are enough to be of
    use.
    """
    import optuna

    level = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        with warnings.catch_warnings():
            # Multivariate sampling is marked experimental: its steps may change with versions.
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            sampler = optuna.samplers.TPESampler(multivariate=True, seed=seed, n_startup_trials=0)
        study = optuna.create_study(direction="maximize", sampler=sampler)
        distributions = {name: _distribution(one) for name, one in parameters.items()}
        for one in design:
            study.add_trial(
                optuna.trial.create_trial(
                    params=_coordinates(parameters, one.evaluation.values),
                    distributions=distributions,
                    value=one.score,
                )
            )
        for _ in range(count):
            trial = study.ask(fixed_distributions=distributions)
            study.tell(trial, step(trial.params))
    finally:
        optuna.logging.set_verbosity(level)


def _by_evolution(
    parameters: Parameters,
    design: Sequence[Step],
    step: Callable[[Mapping[str, Any]], float],
    count: int,
    seed: int,
) -> None:
    """An evolution strategy with adapted covariance (Hansen and Ostermeier 2001), package cma.

    It starts at the best of the design with the standard deviation
    `CALIBRATION.first_deviation` of each range.
    """
    import cma

    start = _coordinates(parameters, best_step(design).evaluation.values)
    # The package takes the seed 0 for the clock's.
    options = {"bounds": [0.0, 1.0], "seed": 1 + seed % (2**31 - 1), "verbose": -9}
    deviation = CALIBRATION.first_deviation
    strategy = cma.CMAEvolutionStrategy(list(start.values()), deviation, options)
    done = 0
    while done < count:
        population = strategy.ask()
        asked = population[: count - done]
        scores = [step(dict(zip(parameters, point, strict=True))) for point in asked]
        done += len(asked)
        if done < count:
            strategy.tell(population, [-value for value in scores])


def _distribution(parameter: CalibrationParameter) -> Any:
    from optuna.distributions import CategoricalDistribution, FloatDistribution

    if parameter.values is not None:
        return CategoricalDistribution(list(range(len(parameter.values))))
    return FloatDistribution(0.0, 1.0)


def _coordinates(parameters: Parameters, values: Mapping[str, Plain]) -> dict[str, float | int]:
    return {
        name: min(max(share_of(one, values[name]), 0.0), 1.0)
        if one.values is None
        else one.values.index(values[name])
        for name, one in parameters.items()
    }


def _values(parameters: Parameters, coordinates: Mapping[str, Any]) -> dict[str, Plain]:
    return {
        name: at_share(one, float(coordinates[name]))
        if one.values is None
        else one.values[int(coordinates[name])]
        for name, one in parameters.items()
    }


def profile_values(
    parameters: Parameters, best: Mapping[str, Plain], points: int
) -> list[dict[str, Plain]]:
    """Sets with all parameters but one at their best, each parameter over its range or list."""
    sets = []
    for name, parameter in parameters.items() if points else ():
        tried: Sequence[Plain]
        if parameter.values is not None:
            tried = parameter.values
        else:
            tried = [at_share(parameter, (i + 0.5) / points) for i in range(points)]
        sets += [{**best, name: value} for value in tried]
    return sets
