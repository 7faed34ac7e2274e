"""`jaxslam study report STORAGE`."""

from pathlib import Path

from jaxslam.cli.arguments import StudyReport
from jaxslam.report import make_folder
from jaxslam.study import load_study, storage_url, write_report
from jaxslam.study.report import counts, importance_table, trial_table
from jaxslam.study.storage import complaints


def execute(command: StudyReport, arguments: list[str]) -> None:
    """Writes the report of a study and prints its tables."""
    url = storage_url(command.storage)
    with complaints(url):
        store, plan = load_study(url, command.name)
        store.give_up_lost()
        folder = command.out or Path("runs") / f"{store.study.study_name}-study"
        make_folder(folder)
        summary = write_report(folder, store, plan)
    print(f"{counts(summary)}\n\n{trial_table(summary)}\n\n{importance_table(summary)}\n")
    print(f"written   {folder} (report.md, trials.json, best.toml, history.png, parallel.png, …)")
