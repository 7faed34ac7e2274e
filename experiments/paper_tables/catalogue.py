"""The experiments: the paper and the question of each, its duration, and the folder of its results."""

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from jaxslam.core.names import check_names

FOLDER = Path(__file__).parents[1]
"""The folder with a package for each experiment, which contains the results."""
REQUIRED = "python -m pip install -e '.[cli,train,vision]'"
"""Command that installs the dependencies of all experiments."""


@dataclass(frozen=True)
class Experiment:
    """A package of `experiments` that `python -m` runs.

    Attributes:
        name: name of the package.
        paper: the paper whose claims are tested, a name in `experiments.paper_tables.papers.PAPERS`.
        hours: approximate duration of the full experiment on two cores.
    """

    name: str
    paper: str
    hours: float

    @property
    def command(self) -> str:
        """The command that runs the full experiment."""
        return f"python -m experiments run {self.name}"

    @property
    def question(self) -> str:
        """The question that the experiment answers.

        Raises:
            ModuleNotFoundError: a dependency of the experiment is not installed.
        """
        return self._module().QUESTION

    @property
    def main(self) -> Callable[[Sequence[str]], None]:
        """The function that runs the experiment; its flags are those of `_harness.harness.parse_options`.

        Raises:
            ModuleNotFoundError: a dependency of the experiment is not installed.
        """
        return self._module().main

    def results(self, root: Path = FOLDER) -> Path:
        """Return the folder of the full results."""
        return root / self.name / "results"

    def _module(self):
        # The import is late because an experiment imports most of the library.
        return importlib.import_module(f"experiments.{self.name}.__main__")


EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        Experiment("tobacco_line", "Liang et al.", hours=2.0),
        Experiment("coal_mine", "Yang et al. 2019", hours=1.5),
        Experiment("range_network", "Jamaludin et al.", hours=1.5),
    )
}


def chosen(names: Sequence[str]) -> list[Experiment]:
    """Return the experiments of these names, in their order and each once; without names, all experiments.

    Raises:
        ValueError: no experiment has that name; the message suggests the closest name.
    """
    check_names("no experiment is called", EXPERIMENTS, *names)
    return [EXPERIMENTS[name] for name in dict.fromkeys(names or EXPERIMENTS)]
