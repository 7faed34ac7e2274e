"""The experiments: what each asks, of which paper, how long it takes, where its results are."""

import difflib
import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parent
"""Has a package for each experiment, and in it the results."""
REQUIRED = "python -m pip install -e '.[cli,train,vision]'"
"""Installs what all of them need."""


@dataclass(frozen=True)
class Experiment:
    """A package here that `python -m` starts.

    Attributes:
        name: of the package.
        paper: whose claims it puts to the test, as in `experiments.papers.PAPERS`.
        hours: that all of it takes on two cores, roughly.
    """

    name: str
    paper: str
    hours: float

    @property
    def command(self) -> str:
        """Runs all of it."""
        return f"python -m experiments run {self.name}"

    @property
    def question(self) -> str:
        """What it answers.

        Raises:
            ModuleNotFoundError: something that it needs is not installed.
        """
        return self._module().QUESTION

    @property
    def main(self) -> Callable[[Sequence[str]], None]:
        """Runs it, with flags as in `experiments.harness.parse_options`.

        Raises:
            ModuleNotFoundError: something that it needs is not installed.
        """
        return self._module().main

    def results(self, root: Path = FOLDER) -> Path:
        """The folder of its full results."""
        return root / self.name / "results"

    def _module(self):
        # When it is needed and no sooner: one brings half of what there is along.
        return importlib.import_module(f"experiments.{self.name}.__main__")


EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        Experiment("tobacco_line", "tobacco", hours=2.0),
        Experiment("coal_mine", "mine", hours=1.5),
        Experiment("range_network", "ann", hours=1.5),
    )
}


def chosen(names: Sequence[str]) -> list[Experiment]:
    """The experiments of these names, all of them without any.

    Raises:
        ValueError: there is none of a name; the message has the nearest.
    """
    for name in names:
        if name not in EXPERIMENTS:
            nearest = difflib.get_close_matches(name, EXPERIMENTS, n=1, cutoff=0.0)[0]
            raise ValueError(
                f"no experiment is called {name!r}: did you mean {nearest!r}? "
                f"There are {', '.join(EXPERIMENTS)}"
            )
    # Each once, in the order that was asked for.
    return [EXPERIMENTS[name] for name in dict.fromkeys(names or EXPERIMENTS)]
