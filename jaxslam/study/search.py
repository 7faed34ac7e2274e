"""The trials of a study: ask the sampler for settings, run them, and report their objectives."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from jax.experimental.compilation_cache import compilation_cache

from jaxslam.config.dotted import Scalar
from jaxslam.study.interrupts import Interrupts
from jaxslam.study.measure import TrialError, check_source, load, measure, program_of
from jaxslam.study.objectives import OBJECTIVES, Figures
from jaxslam.study.plan import Plan, Source
from jaxslam.study.space import Parameter
from jaxslam.study.storage import Store, failure, open_study

HOPELESS = 5
"""A study stops if its first trials, this many, all fail."""


@dataclass(frozen=True)
class TrialResult:
    """A finished trial.

    Attributes:
        number: number in the study.
        settings: settings by dotted name.
        values: the objectives, or the reason for the failure.
        seconds: duration of the batch in which the trial ran.
    """

    number: int
    settings: dict[str, Scalar]
    values: tuple[float, ...] | str
    seconds: float


def keep_programs(folder: Path) -> None:
    """Cache compiled programs in a folder, shared with other workers and later sessions."""
    if jax.config.jax_compilation_cache_dir != str(folder):  # type: ignore[attr-defined]
        # Without a reset, JAX keeps the cache that it chose at its first compilation.
        compilation_cache.reset_cache()
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


def with_lidars(plan: Plan) -> Plan:
    """Return the plan with the lidar of every source, detected from its scans.

    Raises:
        ValueError: a source, held out or not, has no odometry or no overlap with its reference.
        OSError: a source cannot be read.
    """
    for source in (*plan.sources, *plan.held_out):
        check_source(plan, source)
    sources = (dataclasses.replace(source, lidar=load(source).lidar) for source in plan.sources)
    return dataclasses.replace(plan, sources=tuple(sources))


def with_few_programs(plan: Plan) -> Plan:
    """Return the plan with a step for every size of a program, so that few programs are compiled."""
    base = plan.configuration({}, plan.sources[0].lidar)

    def is_size(parameter: Parameter) -> bool:
        held = plan.space.where_it_applies(parameter, base)
        low, high = ({**held, parameter.name: value} for value in parameter.ends())
        return program_of(plan, plan.sources[0], low) != program_of(plan, plan.sources[0], high)

    return dataclasses.replace(plan, space=plan.space.with_steps(is_size))


def run_trials(plan: Plan, url: str, on_trial: Callable[[Store, TrialResult], None]) -> Store:
    """Run trials until the study has the number of finished trials of the plan.

    Raises:
        ValueError: the storage cannot be used, a source cannot be read, or the first trials all fail.
    """
    for source in plan.sources:
        load(source)
    with Interrupts() as interrupts:
        store = open_study(plan, url)
        while (count := len(store.finished())) < plan.trials:
            for result in run_batch(plan, store, min(plan.batch, plan.trials - count), interrupts):
                on_trial(store, result)
            check_hope(store)
    return store


def run_batch(plan: Plan, store: Store, count: int, interrupts: Interrupts) -> list[TrialResult]:
    """Ask for a batch of trials, run trials of one program together, and record all outcomes.

    Args:
        plan: plan of the study.
        store: the study.
        count: number of trials.
        interrupts: lets Ctrl-C through while the trials run; interrupted trials are lost.
    """
    store.fail_stale_trials()
    started = time.perf_counter()
    trials = store.ask(count)
    try:
        with store.alive(trials):
            base = plan.configuration({})
            settings = [plan.space.suggest(trial, base) for trial in trials]
            with interrupts.passing():
                outcomes = evaluate(plan, plan.sources, plan.seeds, settings)
            for trial, outcome in zip(trials, outcomes, strict=True):
                store.tell(trial, outcome)
    except BaseException:
        store.give_up(trials)
        raise
    seconds = time.perf_counter() - started
    return [
        TrialResult(trial.number, tried, outcome if isinstance(outcome, str) else tuple(outcome), seconds)
        for trial, tried, outcome in zip(trials, settings, outcomes, strict=True)
    ]


def evaluate(
    plan: Plan, sources: Sequence[Source], seeds: Sequence[int], settings: Sequence[dict[str, Scalar]]
) -> list[list[float] | str]:
    """Return the objectives of every configuration, averaged over sources, or the reason for a failure."""
    measured: list[list[Figures]] = [[] for _ in settings]
    failures: dict[int, str] = {}
    for source in sources:
        # Settings that failed on one source are not run on the others.
        left = [index for index in range(len(settings)) if index not in failures]
        for index, found in zip(left, measure(plan, source, seeds, [settings[i] for i in left]), strict=True):
            if isinstance(found, TrialError):
                failures[index] = f"{source.name}: {found}"
            else:
                measured[index].append(found)
    outcomes: list[list[float] | str] = []
    objectives = [OBJECTIVES[name] for name in plan.objectives]
    for index, by_source in enumerate(measured):
        if index in failures:
            outcomes.append(failures[index])
            continue
        numbers = [float(np.mean([each.of(figures) for figures in by_source])) for each in objectives]
        finite = np.isfinite(numbers).all()
        outcomes.append(numbers if finite else f"{' and '.join(plan.objectives)} of {numbers} are not finite")
    return outcomes


def check_hope(store: Store) -> None:
    """Raise `ValueError` if the first trials all failed."""
    done = store.finished()
    if len(done) >= HOPELESS and all(trial.values is None for trial in done):
        raise ValueError(
            f"the first {len(done)} trials all failed, the last one because: {failure(done[-1])}"
        )


def held_out_table(
    plan: Plan, settings: dict[str, Scalar]
) -> list[tuple[str, list[float] | str, list[float] | str]]:
    """Compare tuned settings with the base, on the data used for tuning and on held-out data.

    Returns:
        Rows with a name and two outcomes of `evaluate`: one for the base and one for the tuned settings.
    """
    rows = [
        ("tuned on, its seeds", plan.sources, plan.seeds),
        ("tuned on, other seeds", plan.sources, plan.held_out_seeds),
    ]
    rows += [(f"held out: {source.name}", (source,), plan.held_out_seeds) for source in plan.held_out]
    # One by one: configurations that run together would add to each other's time.
    found = []
    for name, sources, seeds in rows:
        before, after = (evaluate(plan, sources, seeds, [tried])[0] for tried in ({}, settings))
        found.append((name, before, after))
    return found
