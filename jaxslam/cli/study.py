"""`jaxslam study CONFIG.toml`."""

import dataclasses
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from jaxslam.cli import options

if TYPE_CHECKING:
    from jaxslam.study import Plan, Store, TrialResult


@dataclass(frozen=True)
class Study:
    """Flags of `jaxslam study`."""

    plan: Annotated[Path, Positional, arg(metavar="CONFIG.toml")]
    """Study file: logs, objectives and settings to tune; see docs/guides/study.md."""
    trials: Annotated[int | None, options.optional("N", "from the file, otherwise 50")] = None
    """Total number of trials, including those already in the storage."""
    storage: Annotated[str | None, options.optional("URL", "runs/<name>.db")] = None
    """A SQLite file, or the URL of a database. An interrupted study resumes from it."""
    cluster: Annotated[str | None, options.optional("ADDRESS", "this process")] = None
    """Run the trials on a Dask cluster: address of its scheduler (tcp://host:8786), or local:N for N local
    processes."""
    out: Annotated[Path | None, options.optional("DIR", "runs/<name>-study", options.FOLDER)] = None


def execute(command: Study, arguments: list[str]) -> None:
    """Run the remaining trials and report."""
    from jaxslam import study
    from jaxslam.report import make_folder
    from jaxslam.study.report import SHOWN, counts, importance_table, trial_table
    from jaxslam.study.storage import connect, redact_url, storage_errors

    plan = study.read_plan(command.plan)
    if command.trials is not None:
        plan = dataclasses.replace(plan, trials=command.trials)
    storage = command.storage or f"runs/{plan.name}.db"
    url = study.storage_url(storage)
    if "://" not in storage:
        make_folder(Path(storage).parent, "--storage")
    # Check the storage before the logs are read.
    connect(url)
    if command.cluster is not None:
        # Dask is an optional dependency of its own.
        from jaxslam.study.workers import check_cluster, run_on_cluster

        check_cluster(command.cluster, url)
    folder = command.out or Path("runs") / f"{plan.name}-study"
    make_folder(folder)
    programs = (folder / "programs").resolve()
    study.keep_programs(programs)
    if command.cluster is None:
        _spread_runs(plan)
    plan = study.with_few_programs(study.with_lidars(plan))
    with storage_errors(url):
        before = len(study.open_study(plan, url).finished())
        _describe(plan, redact_url(url), before)
        if command.cluster is None:
            store = study.run_trials(plan, url, _say)
        else:
            store = run_on_cluster(plan, url, command.cluster, programs, _say)
        summary = study.write_report(folder, store, plan.described())
    print(f"\n{counts(summary)}\n\n{trial_table(summary, SHOWN)}\n\n{importance_table(summary)}\n")
    table = _held_out(plan, summary.best.params)
    print(table)
    (folder / "held-out.md").write_text(table + "\n", encoding="utf-8")
    print(f"written   {folder} (report.md, held-out.md, best.toml, history.png, parallel.png, …)")


def _spread_runs(plan: "Plan") -> None:
    """Distribute the runs of a trial or of a batch over the CPU cores; cluster workers do so on their own."""
    import jax

    from jaxslam.xla.sharding import cores

    # More devices than runs would repeat runs. If time is an objective, configurations run one by one.
    runs = len(plan.seeds) * (1 if "time" in plan.objectives else plan.batch)
    devices = min(len(cores()), runs)
    # After JAX has started, as in a call from Python, the number of devices cannot change.
    with suppress(RuntimeError):
        jax.config.update("jax_num_cpu_devices", devices)


def _describe(plan: "Plan", storage: str, before: int) -> None:
    from jaxslam.study import OBJECTIVES

    print(f"study     {plan.name}: {plan.trials} trials by {plan.sampler}, {before} of them in {storage}")
    print(f"logs      {', '.join(source.name for source in plan.sources)}; seeds {_listed(plan.seeds)}")
    print(f"minimize  {', '.join(OBJECTIVES[name].label for name in plan.objectives)}")
    for parameter in plan.space.parameters:
        print(f"space     {parameter}")


def _say(store: "Store", told: "TrialResult") -> None:
    from jaxslam.study.report import cell

    settings = " ".join(f"{name}={cell(value)}" for name, value in told.settings.items())
    outcome = f"failed: {told.values}" if isinstance(told.values, str) else " ".join(map(cell, told.values))
    print(f"trial {told.number:<4}{outcome}   {settings}   ({told.seconds:.1f} s)", flush=True)


def _held_out(plan: "Plan", settings: dict) -> str:
    """Compare the best settings with the base settings, on the tuning logs and on held-out logs."""
    from jaxslam.study import OBJECTIVES, held_out_table
    from jaxslam.study.report import markdown_table

    labels = [OBJECTIVES[name].label for name in plan.objectives]
    header = ["", *(f"{label}: {which}" for label in labels for which in ("before", "tuned"))]
    rows = []
    for name, before, after in held_out_table(plan, settings):
        pairs = zip(_cells(before, len(labels)), _cells(after, len(labels)), strict=True)
        rows.append([name, *(cell for pair in pairs for cell in pair)])
    return markdown_table(header, rows)


def _cells(outcome: list[float] | str, count: int) -> list[str]:
    """Return one cell for each objective; the first cell of a failed trial has the reason."""
    if isinstance(outcome, str):
        return [f"failed: {outcome}", *[""] * (count - 1)]
    return [f"{value:.4g}" for value in outcome]


def _listed(seeds: tuple[int, ...]) -> str:
    run = seeds == tuple(range(seeds[0], seeds[0] + len(seeds))) and len(seeds) > 1
    return f"{seeds[0]}–{seeds[-1]}" if run else ", ".join(map(str, seeds))
