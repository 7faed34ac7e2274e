"""Hyper-parameter studies: many runs of a filter, settings chosen by Optuna; needs the extra `study`."""

from jaxslam.core.names import optional_import

with optional_import():
    from jaxslam.study.objectives import OBJECTIVES, Figures
    from jaxslam.study.plan import Plan, Source, read_plan
    from jaxslam.study.report import summarize, write_report
    from jaxslam.study.search import (
        TrialResult,
        evaluate,
        held_out_table,
        keep_programs,
        run_trials,
        with_few_programs,
        with_lidars,
    )
    from jaxslam.study.space import Parameter, Space
    from jaxslam.study.storage import Store, load_study, open_study, storage_url

__all__ = [
    "OBJECTIVES",
    "Figures",
    "Parameter",
    "Plan",
    "Source",
    "Space",
    "Store",
    "TrialResult",
    "evaluate",
    "held_out_table",
    "keep_programs",
    "load_study",
    "open_study",
    "read_plan",
    "run_trials",
    "storage_url",
    "summarize",
    "with_few_programs",
    "with_lidars",
    "write_report",
]
