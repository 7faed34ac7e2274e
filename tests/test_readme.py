"""The README keeps its promises: its code runs, its commands parse, CI runs the first two as printed."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from jaxslam.cli.main import parse

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block_after(marker: str) -> str:
    found = re.search(rf"^<!-- {marker} -->\n```\w+\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    assert found is not None, marker
    return found[1]


def shell_lines() -> list[str]:
    blocks = re.findall(r"^```sh\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    lines = "".join(blocks).splitlines()
    return [re.split(r"\s+[>#] ", line)[0] for line in lines if line.startswith("jaxslam ")]


def commands_of_the_tables() -> list[str]:
    return re.findall(r"^\| `(jaxslam [^`]+)`", README, re.MULTILINE)


def test_the_code_runs_in_one_session(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for marker in ("quickstart", "many"):
        exec(compile(block_after(marker), "README.md", "exec"), names)
    means = [
        float(mean) for mean in re.findall(r"^sigma_hit .* RMSE ([\d.]+) m", capsys.readouterr().out, re.M)
    ]
    # The two smaller values give millimeters, the largest decimeters.
    assert len(means) == 3
    assert max(means[:2]) < 0.05 < means[2]
    written = {path.name for path in (tmp_path / "runs" / "first").iterdir()}
    assert {"map.png", "map.yaml", "map.pgm", "trajectory.tum", "metrics.json", "config.toml"} <= written
    assert set(re.findall(r"^import (\w+)", block_after("quickstart"), re.MULTILINE)) == {"jax", "jaxslam"}


@pytest.mark.parametrize("line", shell_lines())
def test_the_commands_parse(line):
    words = shlex.split(line)[1:]
    assert type(parse(words)).__name__.lower() == words[0].replace("-", "")


@pytest.mark.parametrize("line", [line for line in commands_of_the_tables() if len(line.split()) > 2])
def test_the_commands_of_the_table_parse(line):
    parse(shlex.split(line)[1:])


def test_the_front_page_of_the_docs_has_the_same_code():
    docs = ROOT / "docs"
    if not docs.is_dir():
        pytest.skip("a source distribution has no docs")
    assert block_after("quickstart") in (docs / "index.md").read_text(encoding="utf-8")
    first, many = re.findall(
        r"^```python\n(.*?)^```$", (docs / "guides" / "many-runs.md").read_text("utf-8"), re.M | re.S
    )
    assert block_after("quickstart").startswith(first)
    assert block_after("many") == many


def test_the_files_that_the_readme_links_to_are_there():
    linked = re.findall(r"\]\(([^)#:]+)\)|src=\"([^\"]+)\"", README)
    assert linked
    for link, picture in linked:
        if not (ROOT / "docs").is_dir() and (link or picture).startswith("docs/"):
            continue  # a source distribution has no docs
        assert (ROOT / (link or picture)).is_file(), link or picture


def test_ci_runs_the_two_commands_of_the_first_screen():
    script = ROOT / ".ci" / "run"
    if not script.exists():
        pytest.skip("a source distribution has no .ci/run")
    printed = subprocess.run([script, "--print"], capture_output=True, text=True, check=True).stdout
    assert printed == block_after("ci: main-job") + block_after("ci: tests")
