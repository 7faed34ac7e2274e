"""The plan of a study: logs, search space, seeds, objectives. Read from TOML, checked before any run."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxslam.config import toml
from jaxslam.config.dotted import Scalar
from jaxslam.config.lidar_presets import PRESETS, LidarPreset, lidar_preset
from jaxslam.config.slam import SlamConfig
from jaxslam.core.names import check_names
from jaxslam.sim.worlds.halls import WORLDS
from jaxslam.study.objectives import OBJECTIVES
from jaxslam.study.space import Space, with_settings

SAMPLERS = ("tpe", "cma-es", "nsga-ii", "random")
HELD_OUT_SEEDS = 1000
"""The first held-out seed, unless the plan gives its own."""
MOST_SEEDS = 10_000
"""Most runs of one configuration; a larger number is probably a typing error."""
DRIVE = 60.0
"""Default duration of a simulated drive, seconds."""
LONGEST = 86_400
"""Longest duration of a drive, seconds; all of its scans are kept in memory."""
_LARGEST_SEED = 2**32 - 1
"""`jax.random.key` uses only the last 32 bits of a larger seed."""


@dataclass(frozen=True)
class Source:
    """Data to map: a log on disk with its reference, or a simulated drive with the ground truth.

    Attributes:
        name: name in tables.
        log: path of the log; None for a simulation.
        relations: path of known relations, for a log.
        reference: path of a reference trajectory (TUM), for a log.
        world: name in `jaxslam.sim.WORLDS`; None for a log.
        duration: seconds to drive in a world (60 if not given), or to read from the start of a log (all if
            not given).
        seed: seed of the simulation's noise.
        lidar: name of a preset, or the properties of the lidar; None detects them from the scans.
    """

    name: str
    log: str | None = None
    relations: str | None = None
    reference: str | None = None
    world: str | None = None
    duration: float | None = None
    seed: int = 0
    lidar: str | LidarPreset | None = None


@dataclass(frozen=True)
class Plan:
    """A study.

    Attributes:
        name: name of the study in the storage.
        base: settings that differ from the defaults, by dotted name; the same in every trial.
        sources: data for tuning.
        held_out: data for one final check.
        seeds: seeds of every trial; all trials use the same ones, so that only their settings differ.
        held_out_seeds: seeds of the final check.
        space: the search space.
        objectives: names in `OBJECTIVES`, all minimized.
        sampler: one of `SAMPLERS`.
        sampler_seed: seed of the sampler.
        trials: total number of trials; sessions that share a study may each run one batch more.
        batch: number of trials asked for at a time; trials that share a program run together.
    """

    name: str
    base: Mapping[str, Scalar]
    sources: tuple[Source, ...]
    held_out: tuple[Source, ...]
    seeds: tuple[int, ...]
    held_out_seeds: tuple[int, ...]
    space: Space
    objectives: tuple[str, ...] = ("error",)
    sampler: str = "tpe"
    sampler_seed: int = 0
    trials: int = 50
    batch: int = 1

    def configuration(
        self, settings: Mapping[str, Scalar], lidar: str | LidarPreset | None = None
    ) -> SlamConfig:
        """Return the base configuration with the settings of a trial.

        Raises:
            ValueError: a setting is out of range.
        """
        return with_settings(with_settings(starting_with(lidar), self.base), settings)

    def described(self) -> dict[str, Any]:
        """Return, as JSON types, everything that must be equal for two trials to be comparable."""
        kept = dataclasses.asdict(self)
        for name in ("sampler", "sampler_seed", "trials", "batch", "held_out", "held_out_seeds"):
            del kept[name]
        return json.loads(json.dumps(kept))


def starting_with(lidar: str | LidarPreset | Mapping[str, Any] | None) -> SlamConfig:
    """Return the default configuration with a lidar, given by name, preset or JSON dictionary."""
    if lidar is None:
        return SlamConfig()
    if isinstance(lidar, str):
        lidar = lidar_preset(lidar)
    elif isinstance(lidar, Mapping):
        # JSON has no tuples.
        known: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in lidar.items()}
        lidar = LidarPreset(**known)
    return SlamConfig().with_lidar(lidar)


def read_plan(path: str | Path) -> Plan:
    """Read and check a study.

    Raises:
        ValueError: the file is not TOML, a name in it is unknown (the message suggests the closest match), a
            value is out of range, the space is empty, or a source has no reference; one line.
        OSError: the file cannot be read.
    """
    path = Path(path)
    tables = toml.read_tables(path, "a study in TOML, as docs/guides/study.md shows")
    try:
        return _plan(tables, path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _plan(tables: dict[str, Any], path: Path) -> Plan:
    check_names("a study has no table", ("study", "filter", "logs", "held_out", "space"), *tables)
    study = _table(tables, "study")
    check_names("[study] has no", tuple(_DEFAULTS), *study)
    given = {**_DEFAULTS, "name": path.stem, **study}
    for key, least in (("seed", 0), ("trials", 1), ("batch", 1)):
        if not (type(given[key]) is int and given[key] >= least):
            raise ValueError(f"study.{key} is {given[key]!r}: give a whole number, {least} or more")
    name = given["name"]
    # The name is also used for files.
    if not (isinstance(name, str) and name.isprintable() and name.strip(". ") and not set(name) & set("/\\")):
        raise ValueError(f"study.name is {name!r}: give text that can be the name of a file")
    base = _base(study, _table(tables, "filter"), path.parent)
    # Report invalid settings here, before the first trial.
    configuration = with_settings(SlamConfig(), base)
    seeds = _seeds(given["seeds"], 0, "study.seeds")
    first = max(HELD_OUT_SEEDS, *(seed + 1 for seed in seeds))
    held_out_seeds = _seeds(given["held_out_seeds"], first, "study.held_out_seeds")
    if set(seeds) & set(held_out_seeds):
        both = ", ".join(map(str, sorted(set(seeds) & set(held_out_seeds))))
        raise ValueError(f"study.held_out_seeds has {both}, which are tuning seeds: give others")
    objectives = _chosen(given["objectives"], tuple(OBJECTIVES), "study.objectives")
    [sampler] = _chosen([given["sampler"]], SAMPLERS, "study.sampler")
    if sampler == "cma-es" and len(objectives) > 1:
        raise ValueError("study.sampler is cma-es, which takes one objective: use nsga-ii or tpe for several")
    sources = _sources(tables.get("logs", []), "logs", path.parent)
    if not sources:
        raise ValueError("no [[logs]]: give one or more to tune on")
    held_out = _sources(tables.get("held_out", []), "held_out", path.parent)
    for source in (*sources, *held_out):
        for objective in objectives:
            OBJECTIVES[objective].check(source)
    names = toml.named(_table(tables, "space"), leaves=("low", "high", "step", "log", "choices"))
    plan = Plan(
        name=name,
        base=base,
        sources=sources,
        held_out=held_out,
        seeds=seeds,
        held_out_seeds=held_out_seeds,
        space=Space.from_tables(names, configuration),
        objectives=objectives,
        sampler=sampler,
        sampler_seed=given["seed"],
        trials=given["trials"],
        batch=given["batch"],
    )
    _check_bounds(plan)
    return plan


_DEFAULTS: dict[str, Any] = {
    "name": "",
    "config": None,
    "method": None,
    "seeds": 3,
    "held_out_seeds": 3,
    "objectives": ["error"],
    "sampler": "tpe",
    "seed": 0,
    "trials": 50,
    "batch": 1,
}


def _base(study: Mapping[str, Any], settings: dict[str, Any], folder: Path) -> dict[str, Scalar]:
    """Collect the differences from the defaults: the method, a file, the table [filter], in this order."""
    base: dict[str, Any] = {"method": study["method"]} if "method" in study else {}
    if "config" in study:
        base |= toml.read_settings(_existing(study["config"], folder, "study.config"))
    return base | toml.named(settings)


def _sources(tables: Any, name: str, folder: Path) -> tuple[Source, ...]:
    if not isinstance(tables, list):
        raise ValueError(f"{name} is one table: write [[{name}]] with two brackets")
    known = tuple(field.name for field in dataclasses.fields(Source))
    found: list[Source] = []
    for index, table in enumerate(tables):
        where = f"[[{name}]] {index + 1}"
        if not isinstance(table, dict):
            raise ValueError(f"{table!r} stands where a table is wanted")
        check_names(f"{where} has no", known, *table)
        if ("log" in table) == ("world" in table):
            raise ValueError(f"{where}: give a log or a world")
        if "world" in table:
            _chosen([table["world"]], tuple(WORLDS), f"{where} world")
        for key in ("relations", "reference") if "world" in table else ("seed",):
            if key in table:
                reason = "a log; of a world the truth is known" if "world" in table else "a world"
                raise ValueError(f"{where}: {key} is for {reason}")
        if "relations" in table and "reference" in table:
            raise ValueError(f"{where}: give relations or a reference, not both")
        if not isinstance(table.get("name", ""), str):
            raise ValueError(f"{where} name is {table['name']!r}: give text")
        if "lidar" in table:
            _chosen([table["lidar"]], tuple(PRESETS), f"{where} lidar")
        duration = table.get("duration", DRIVE)
        if not (type(duration) in (int, float) and 0 < duration <= LONGEST):
            raise ValueError(
                f"{where} duration is {duration!r}: give seconds, more than 0, at most {LONGEST}"
            )
        if not _is_seed(table.get("seed", 0)):
            raise ValueError(f"{where} seed is {table['seed']!r}: give 0 to {_LARGEST_SEED}")
        paths = {
            key: str(_existing(table[key], folder, f"{where} {key}"))
            for key in ("log", "relations", "reference")
            if key in table
        }
        label = Path(table["log"]).name if "log" in table else f"{table['world']}-{table.get('seed', 0)}"
        found.append(Source(**{"name": label, **table, **paths}))
    return tuple(found)


def _check_bounds(plan: Plan) -> None:
    """Check both ends of every parameter, so that an invalid bound does not cost a trial."""
    base = plan.configuration({})
    for parameter in plan.space.parameters:
        holds = plan.space.where_it_applies(parameter, base)
        for value in parameter.ends():
            try:
                plan.configuration({**holds, parameter.name: value})
            except ValueError as error:
                raise ValueError(f"space: {parameter.name} = {value!r}: {error}") from None


def _existing(path: Any, folder: Path, name: str) -> Path:
    if not isinstance(path, str):
        raise ValueError(f"{name} is {path!r}: give a path as text")
    # Paths are relative to the study's file.
    full = (folder / path).resolve()
    if not full.exists():
        raise ValueError(f"{name}: {full} does not exist")
    return full


def _seeds(given: Any, first: int, name: str) -> tuple[int, ...]:
    if type(given) is int and 1 <= given <= MOST_SEEDS:
        return tuple(range(first, first + given))
    if not isinstance(given, list) or not given or not all(map(_is_seed, given)):
        raise ValueError(
            f"{name} is {given!r}: give a number, 1 to {MOST_SEEDS}, or a list of seeds, 0 to {_LARGEST_SEED}"
        )
    if len(set(given)) < len(given):
        raise ValueError(f"{name} is {given!r}: give each seed once")
    return tuple(given)


def _is_seed(value: Any) -> bool:
    return type(value) is int and 0 <= value <= _LARGEST_SEED


def _chosen(given: Any, known: Sequence[str], name: str) -> tuple[str, ...]:
    if not isinstance(given, list) or not given:
        raise ValueError(f"{name} is {given!r}: give a list with some of {', '.join(known)}")
    check_names(f"{name} is", known, *given)
    if len(set(given)) < len(given):
        raise ValueError(f"{name} names one twice: {', '.join(given)}")
    return tuple(given)


def _table(tables: Mapping[str, Any], name: str) -> dict[str, Any]:
    table = tables.get(name, {})
    if not isinstance(table, dict):
        raise ValueError(f"{name} is {table!r}: write a table, [{name}]")
    return table
