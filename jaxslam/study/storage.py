"""Where the trials of a study are kept: a SQLite file, or any database that SQLAlchemy has a URL for."""

import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import sqlalchemy.exc
from optuna.samplers import BaseSampler, CmaEsSampler, NSGAIISampler, RandomSampler, TPESampler
from optuna.storages import RDBStorage
from optuna.trial import FrozenTrial, TrialState

from jaxslam.study.plan import Plan

HEARTBEAT, GRACE = 10, 30
"""Seconds between two signs of life of a trial, and after which one without counts as lost."""
_PLAN = "plan"
_FAILURE = "failure"


def storage_url(storage: str) -> str:
    """A URL as it is; of a path, that of the SQLite file there."""
    return storage if "://" in storage else f"sqlite:///{Path(storage).resolve()}"


@dataclass(frozen=True)
class Store:
    """A study in its storage.

    Attributes:
        study: Optuna's.
        storage: that keeps it.
    """

    study: optuna.Study
    storage: RDBStorage

    def trials(self) -> list[FrozenTrial]:
        """All trials, those in flight and those lost with them."""
        return self.study.get_trials(deepcopy=False)

    def finished(self) -> list[FrozenTrial]:
        """Trials that came to an end: with values, or with a failure that they tell of.

        Those that a killed process left behind are neither, and are made up for.
        """
        return [trial for trial in self.trials() if trial.state == TrialState.COMPLETE or failure(trial)]

    def give_up_lost(self) -> None:
        """Marks the trials of which nothing was heard any more as failed."""
        with _known_warnings():
            optuna.storages.fail_stale_trials(self.study)

    def ask(self, count: int) -> list[optuna.Trial]:
        """New trials, as the sampler wants them."""
        with _known_warnings():
            return [self.study.ask() for _ in range(count)]

    def tell(self, trial: optuna.Trial, outcome: Sequence[float] | str) -> None:
        """Records the values of a trial, or why there are none."""
        if isinstance(outcome, str):
            trial.set_user_attr(_FAILURE, outcome)
            self.study.tell(trial, state=TrialState.FAIL)
        else:
            self.study.tell(trial, list(outcome))

    @contextmanager
    def alive(self, trials: Sequence[optuna.Trial]) -> Iterator[None]:
        """Signs of life of these trials, meanwhile: a process that is killed gives no more."""
        study_id = self.storage.get_study_id_from_name(self.study.study_name)
        ids = [
            self.storage.get_trial_id_from_study_id_trial_number(study_id, trial.number) for trial in trials
        ]
        done = threading.Event()

        def beat() -> None:
            while True:
                for trial_id in ids:
                    self.storage.record_heartbeat(trial_id)
                if done.wait(HEARTBEAT):
                    return

        thread = threading.Thread(target=beat, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()


def failure(trial: FrozenTrial) -> str | None:
    """Why a trial has no values; None if it has, or was lost."""
    return trial.user_attrs.get(_FAILURE)


def connect(url: str) -> RDBStorage:
    """A storage, with its tables made where there are none.

    Raises:
        ValueError: it cannot be opened or written; one line.
    """
    # Workers wait for each other's writes.
    arguments = {"timeout": 60} if url.startswith("sqlite") else {}
    try:
        with _known_warnings():
            return RDBStorage(
                url,
                engine_kwargs={"connect_args": arguments},
                heartbeat_interval=HEARTBEAT,
                grace_period=GRACE,
            )
    except (sqlalchemy.exc.SQLAlchemyError, ImportError, RuntimeError) as error:
        raise ValueError(f"{url}: this storage cannot be used: {_reason(error)}") from None


def open_study(plan: Plan, url: str, stream: int = 0) -> Store:
    """The study of that plan in a storage, made if it is not there.

    Args:
        plan: of the study.
        url: of the storage.
        stream: of the sampler's random numbers: those who share a study must not draw the same.

    Raises:
        ValueError: the storage has a study of that name by another plan, or cannot be written.
    """
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = connect(url)
    try:
        study = optuna.create_study(
            storage=storage,
            sampler=_sampler(plan, stream),
            study_name=plan.name,
            directions=["minimize"] * len(plan.objectives),
            load_if_exists=True,
        )
        before = study.user_attrs.get(_PLAN)
        if before is None:
            study.set_user_attr(_PLAN, plan.described())
    except (sqlalchemy.exc.SQLAlchemyError, optuna.exceptions.StorageInternalError) as error:
        raise ValueError(f"{url}: this storage cannot be written: {_reason(error)}") from None
    if before is not None and before != plan.described():
        raise ValueError(
            f"{url} has a study {plan.name!r} whose logs, seeds, filter, space or objectives are others: "
            "give this one another name ([study] name), or another storage"
        )
    return Store(study, storage)


def load_study(url: str, name: str | None) -> tuple[Store, dict[str, Any]]:
    """A study to report on, and what describes its plan.

    Raises:
        ValueError: there is none, or not the one that was named, or several of which none was.
    """
    if url.startswith("sqlite:///") and not Path(url.removeprefix("sqlite:///")).exists():
        raise ValueError(f"{url.removeprefix('sqlite:///')} is not there: give the storage of a study")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = connect(url)
    names = optuna.get_all_study_names(storage)
    if not names:
        raise ValueError(f"{url}: no study in it")
    if name is None and len(names) > 1:
        raise ValueError(f"{url} has several studies: give --name, one of {', '.join(names)}")
    if name is not None and name not in names:
        raise ValueError(f"{url} has no study {name!r}: there are {', '.join(names)}")
    study = optuna.load_study(study_name=name or names[0], storage=storage)
    plan = study.user_attrs.get(_PLAN)
    if plan is None:
        raise ValueError(f"{url}: the study {study.study_name!r} is not one of jaxslam's")
    return Store(study, storage), plan


@contextmanager
def _known_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        # Optuna has had signs of life as an experiment since its version 2; `alive` gives them here.
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        warnings.filterwarnings("ignore", "Heartbeat of storage", UserWarning)
        yield


def _reason(error: BaseException) -> str:
    return str(error.__cause__ or error).strip().splitlines()[0]


def _sampler(plan: Plan, stream: int) -> BaseSampler:
    seed = int(np.random.SeedSequence((plan.sampler_seed, stream)).generate_state(1)[0])
    if plan.sampler == "cma-es":
        # It cannot choose: choices, and what only some of them have, are drawn.
        return CmaEsSampler(seed=seed, warn_independent_sampling=False)
    if plan.sampler == "nsga-ii":
        return NSGAIISampler(seed=seed, population_size=max(4, min(50, plan.trials // 4)))
    if plan.sampler == "random":
        return RandomSampler(seed=seed)
    return TPESampler(seed=seed, constant_liar=True)
