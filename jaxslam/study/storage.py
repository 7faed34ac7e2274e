"""Storage of a study: a SQLite file, or any database with an SQLAlchemy URL."""

import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import sqlalchemy.exc
from optuna.distributions import BaseDistribution
from optuna.exceptions import StorageInternalError, UpdateFinishedTrialError
from optuna.samplers import BaseSampler, CmaEsSampler, NSGAIISampler, RandomSampler, TPESampler
from optuna.storages import RDBStorage
from optuna.trial import FrozenTrial, TrialState

from jaxslam.study.plan import Plan

HEARTBEAT, GRACE = 10, 30
"""Seconds between two heartbeats of a trial, and seconds without a heartbeat until it counts as lost."""
_ATTEMPTS = 20
_PLAN = "plan"
_FAILURE = "failure"
_ELSEWHERE = "give this one another name ([study] name), or another storage"


def storage_url(storage: str) -> str:
    """Return a URL unchanged; for a path, return the URL of the SQLite file there."""
    if "://" in storage:
        return storage
    return sqlalchemy.URL.create("sqlite", database=str(Path(storage).resolve())).render_as_string()


def redact_url(url: str) -> str:
    """Return a URL for messages: without its password, and a SQLite file as its path."""
    try:
        parts = sqlalchemy.make_url(url)
    except sqlalchemy.exc.ArgumentError:
        return url
    if parts.drivername == "sqlite" and parts.database and not parts.query:
        return parts.database
    return parts.render_as_string(hide_password=True)


@dataclass(frozen=True)
class Store:
    """A study in its storage.

    Attributes:
        study: the Optuna study.
        storage: the storage that holds it.
    """

    study: optuna.Study
    storage: RDBStorage

    def trials(self) -> list[FrozenTrial]:
        """Return all trials, including trials in flight and lost trials."""
        return self.study.get_trials(deepcopy=False)

    def finished(self) -> list[FrozenTrial]:
        """Return the finished trials: with values, or with a recorded failure.

        A trial left behind by a killed process is neither; the study runs another one in its place.
        """
        return [trial for trial in self.trials() if trial.state == TrialState.COMPLETE or failure(trial)]

    def fail_stale_trials(self) -> None:
        """Mark trials whose heartbeat has stopped as failed."""
        with _known_warnings():
            optuna.storages.fail_stale_trials(self.study)

    def ask(self, count: int) -> list[optuna.Trial]:
        """Ask the sampler for new trials."""
        with _known_warnings():
            return [self.study.ask() for _ in range(count)]

    def tell(self, trial: optuna.Trial, outcome: Sequence[float] | str) -> None:
        """Record the values of a trial, or the reason for its failure."""
        # If this computer slept for longer than the grace period, another process has failed the trial.
        with suppress(UpdateFinishedTrialError):
            if isinstance(outcome, str):
                trial.set_user_attr(_FAILURE, outcome)
                self.study.tell(trial, state=TrialState.FAIL, skip_if_finished=True)
            else:
                self.study.tell(trial, list(outcome), skip_if_finished=True)

    def give_up(self, trials: Sequence[optuna.Trial]) -> None:
        """Mark trials as lost: their values are unknown."""
        for trial in trials:
            self.study.tell(trial, state=TrialState.FAIL, skip_if_finished=True)

    @contextmanager
    def alive(self, trials: Sequence[optuna.Trial]) -> Iterator[None]:
        """Record heartbeats of these trials while the context is open; a killed process sends no more."""
        study_id = self.storage.get_study_id_from_name(self.study.study_name)
        ids = [
            self.storage.get_trial_id_from_study_id_trial_number(study_id, trial.number) for trial in trials
        ]
        done = threading.Event()

        def beat() -> None:
            for trial_id in ids:
                self.storage.record_heartbeat(trial_id)

        def beat_on() -> None:
            while not done.wait(HEARTBEAT):
                # A storage that is unreachable now may be back at the next heartbeat.
                with suppress(sqlalchemy.exc.SQLAlchemyError, StorageInternalError):
                    beat()

        # Optuna never fails a trial without a first heartbeat.
        beat()
        thread = threading.Thread(target=beat_on, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()


def failure(trial: FrozenTrial) -> str | None:
    """Return why a trial has no values; None if it has values or was lost."""
    return trial.user_attrs.get(_FAILURE)


def connect(url: str) -> RDBStorage:
    """Open a storage and create its tables if they are missing.

    Raises:
        ValueError: the storage cannot be opened or written; one line.
    """
    # Workers wait for each other's writes.
    options = {"connect_args": {"timeout": 60} if url.startswith("sqlite") else {}}
    # ImportError: the driver is missing. RuntimeError: the tables are of another version of Optuna.
    with storage_errors(url, ImportError, RuntimeError), _known_warnings():
        for _ in range(_ATTEMPTS):
            try:
                return RDBStorage(
                    url, engine_kwargs=options, heartbeat_interval=HEARTBEAT, grace_period=GRACE
                )
            except sqlalchemy.exc.DBAPIError as error:
                # Another process has created the same table between the check and the creation.
                made = isinstance(error, sqlalchemy.exc.IntegrityError) or "already exists" in str(error.orig)
                if not made:
                    raise
        raise RuntimeError(f"its tables could not be created in {_ATTEMPTS} attempts")


@contextmanager
def storage_errors(url: str, *more: type[Exception]) -> Iterator[None]:
    """Turn errors of a storage, and those of types `more`, into a one-line `ValueError`."""
    caught: tuple[type[Exception], ...] = (sqlalchemy.exc.SQLAlchemyError, StorageInternalError, *more)
    try:
        yield
    except caught as error:
        raise ValueError(f"{redact_url(url)}: this storage cannot be used: {_reason(error)}") from None


def open_study(plan: Plan, url: str) -> Store:
    """Open the study of a plan in a storage, and create it if it is missing.

    Raises:
        ValueError: the storage has a study of that name with another plan, or cannot be written.
    """
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = connect(url)
    with storage_errors(url):
        study = optuna.create_study(
            storage=storage,
            sampler=_ByNumber(plan),
            study_name=plan.name,
            directions=["minimize"] * len(plan.objectives),
            load_if_exists=True,
        )
        before = study.user_attrs.get(_PLAN)
        if before is None and study.get_trials(deepcopy=False):
            raise ValueError(f"{redact_url(url)}: its study {plan.name!r} is not from jaxslam: {_ELSEWHERE}")
        if before is not None and before != plan.described():
            raise ValueError(
                f"{redact_url(url)} has a study {plan.name!r} with other logs, seeds, filter, space or "
                f"objectives: {_ELSEWHERE}"
            )
        if before is None:
            study.set_user_attr(_PLAN, plan.described())
    return Store(study, storage)


def load_study(url: str, name: str | None) -> tuple[Store, dict[str, Any]]:
    """Load a study for a report, and the description of its plan.

    Raises:
        ValueError: the storage has no study, no study of that name, or several studies and no name is given.
    """
    with storage_errors(url, ImportError):
        parts = sqlalchemy.make_url(url)
        is_file = parts.get_backend_name() == "sqlite" and parts.database and not parts.query
        if is_file and not Path(parts.database or "").exists():
            raise ValueError(f"{parts.database} does not exist: give the storage of a study")
        # Optuna would create its tables in any database, but a report must not change one.
        engine = sqlalchemy.create_engine(parts)
        has_tables = sqlalchemy.inspect(engine).has_table("studies")
        engine.dispose()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = connect(url) if has_tables else None
    names = [] if storage is None else optuna.get_all_study_names(storage)
    if storage is None or not names:
        raise ValueError(f"{redact_url(url)}: no study in it")
    if name is None and len(names) > 1:
        raise ValueError(f"{redact_url(url)} has several studies: give --name, one of {', '.join(names)}")
    if name is not None and name not in names:
        raise ValueError(f"{redact_url(url)} has no study {name!r}: there are {', '.join(names)}")
    study = optuna.load_study(study_name=name or names[0], storage=storage)
    plan = study.user_attrs.get(_PLAN)
    if plan is None:
        raise ValueError(f"{redact_url(url)}: the study {study.study_name!r} is not from jaxslam")
    return Store(study, storage), plan


@contextmanager
def _known_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        # Heartbeats have been experimental in Optuna since version 2; here `alive` sends them.
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        warnings.filterwarnings("ignore", "Heartbeat of storage", UserWarning)
        yield


def _reason(error: BaseException) -> str:
    cause = error.__cause__ or error
    return (str(cause).strip() or type(cause).__name__).splitlines()[0]


class _ByNumber(BaseSampler):
    """A sampler whose draws depend on the trial's number only.

    Otherwise sessions that continue or share a study would draw the same random numbers and repeat trials.
    """

    def __init__(self, plan: Plan):
        self._plan = plan
        self._made: dict[int, BaseSampler] = {}

    def _of(self, trial: FrozenTrial) -> BaseSampler:
        if trial.number not in self._made:
            self._made[trial.number] = _sampler(self._plan, trial.number)
        return self._made[trial.number]

    def before_trial(self, study: optuna.Study, trial: FrozenTrial) -> None:
        self._of(trial).before_trial(study, trial)

    def infer_relative_search_space(
        self, study: optuna.Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        return self._of(trial).infer_relative_search_space(study, trial)

    def sample_relative(
        self, study: optuna.Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        return self._of(trial).sample_relative(study, trial, search_space)

    def sample_independent(
        self, study: optuna.Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        return self._of(trial).sample_independent(study, trial, param_name, param_distribution)

    def after_trial(
        self, study: optuna.Study, trial: FrozenTrial, state: TrialState, values: Sequence[float] | None
    ) -> None:
        self._of(trial).after_trial(study, trial, state, values)
        del self._made[trial.number]


def _sampler(plan: Plan, number: int) -> BaseSampler:
    seed = int(np.random.SeedSequence((plan.sampler_seed, number)).generate_state(1)[0])
    if plan.sampler == "cma-es":
        # CMA-ES cannot handle choices: they, and parameters that depend on them, are drawn at random.
        return CmaEsSampler(seed=seed, warn_independent_sampling=False)
    if plan.sampler == "nsga-ii":
        return NSGAIISampler(seed=seed, population_size=max(4, min(50, plan.trials // 4)))
    if plan.sampler == "random":
        return RandomSampler(seed=seed)
    return TPESampler(seed=seed, constant_liar=True)
