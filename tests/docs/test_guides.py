"""The guides: their code runs, their commands parse, their pages are all in the navigation.

The README's code, which the front page and a guide repeat, runs in `tests/test_readme.py`.
"""

import importlib
import re
import shlex

import jax
import pytest

import jaxslam
from jaxslam.cli.main import parse
from jaxslam.config.dotted import flatten, update
from jaxslam.config.registry import VARIANTS
from jaxslam.study import read_plan
from tests.docs.pages import DOCS, ROOT, block_after, commands, run_blocks

PAGES = sorted(DOCS.rglob("*.md"))


def test_use_from_python():
    names = run_blocks(DOCS / "guides" / "python.md")
    # The scan over the log is the loop under `run_log`.
    assert names["infos"].ess.shape == names["result"].ess.shape
    assert names["many"].errors(names["truth"]).shape == (1, 2)


def test_settings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = run_blocks(DOCS / "guides" / "settings.md")["config"]
    assert (config.num_particles, config.lidar.name, config.method) == (50, "urg-04lx", "gaussian")
    assert config.sensor.sigma_hit == 0.08


def test_traced_values_share_a_program():
    jax.clear_caches()  # programs are shared by all wrappers of one function
    assert run_blocks(DOCS / "concepts" / "tracing.md")["run"]._cache_size() == 1


def test_the_study_can_be_read(tmp_path):
    path = tmp_path / "hall.toml"
    path.write_text(block_after(DOCS / "guides" / "study.md", "study"), encoding="utf-8")
    plan = read_plan(path)
    assert plan.space.parameters[0].name == "proposal.kind"
    assert len(plan.space.parameters) == 4


@pytest.mark.parametrize("line", [line for page in PAGES for line in commands(page)])
def test_the_commands_parse(line):
    words = shlex.split(line)[1:]
    name = "studyreport" if words[:2] == ["study", "report"] else words[0].replace("-", "")
    assert type(parse(words)).__name__.lower() == name


def test_every_page_is_in_the_navigation():
    listed = re.findall(r": (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    # The changelog stands outside of the folder.
    assert {str(page.relative_to(DOCS)) for page in PAGES} | {"changelog.md"} == set(listed)


def test_every_command_has_a_guide():
    text = "\n".join(page.read_text(encoding="utf-8") for page in (DOCS / "guides").glob("*.md"))
    for command in ("run", "demo", "localize", "info", "config", "fuse", "train-range", "study", "fetch"):
        assert f"`jaxslam {command}`" in text


def _texts() -> str:
    pages = [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    return "\n".join(page.read_text(encoding="utf-8") for page in pages)


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(jaxslam(?:\.\w+)+)[`(]", _texts()))))
def test_the_names_exist(name):
    found, _, rest = name.partition(".")
    value = jaxslam
    while rest:
        part, _, rest = rest.partition(".")
        found = f"{found}.{part}"
        value = getattr(value, part) if hasattr(value, part) else importlib.import_module(found)


def test_the_settings_exist():
    mapping = jaxslam.SlamConfig().with_lidar("sick")
    known = set(flatten(jaxslam.LocalizationConfig())) | set(flatten(mapping))
    for base, part in zip(VARIANTS, ("motion", "sensor", "proposal", "resampling.scheme"), strict=True):
        for kind in VARIANTS[base]:
            known |= set(flatten(update(mapping, {f"{part}.kind": kind})))
    tables = "|".join({name.partition(".")[0] for name in known if "." in name})
    files = r"(?!(?:png|yaml|pgm|gif)\b)"
    named = set(re.findall(rf"`(?:--set )?((?:{tables})\.{files}[a-z_.]+\w)", _texts()))
    assert len(named) > 20
    assert {name for name in named if not any(full.startswith(name) for full in known)} == set()
