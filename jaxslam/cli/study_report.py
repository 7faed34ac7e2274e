"""`jaxslam study report STORAGE`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from jaxslam.cli import options


@dataclass(frozen=True)
class StudyReport:
    """Flags of `jaxslam study report`."""

    storage: Annotated[str, Positional, arg(metavar="STORAGE")]
    """The SQLite file, or the URL of a database, that holds the study."""
    name: Annotated[str | None, options.optional("NAME", "the only one")] = None
    """Name of the study, if the storage holds several."""
    out: Annotated[Path | None, options.optional("DIR", "runs/<name>-study", options.FOLDER)] = None


def execute(command: StudyReport, arguments: list[str]) -> None:
    """Write the report of a study and print its tables."""
    from jaxslam.report import make_folder
    from jaxslam.study import load_study, storage_url, write_report
    from jaxslam.study.report import counts, importance_table, trial_table
    from jaxslam.study.storage import storage_errors

    url = storage_url(command.storage)
    with storage_errors(url):
        store, plan = load_study(url, command.name)
        store.fail_stale_trials()
        folder = command.out or Path("runs") / f"{store.study.study_name}-study"
        make_folder(folder)
        summary = write_report(folder, store, plan)
    print(f"{counts(summary)}\n\n{trial_table(summary)}\n\n{importance_table(summary)}\n")
    print(f"written   {folder} (report.md, trials.json, best.toml, history.png, parallel.png, …)")
