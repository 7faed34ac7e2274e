"""What the README promises: the code runs, the commands parse, CI runs the first two as they stand."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from jaxslam.cli.main import parse
from jaxslam.study import read_plan

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block_after(marker: str) -> str:
    found = re.search(rf"^<!-- {marker} -->\n```\w+\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    assert found is not None, marker
    return found[1]


def shell_lines() -> list[str]:
    blocks = re.findall(r"^```sh\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    return [line.partition(" > ")[0] for line in "".join(blocks).splitlines() if line.startswith("jaxslam ")]


def test_the_quickstart_runs(capsys):
    exec(compile(block_after("quickstart"), "README.md", "exec"), {})
    assert re.search(r"\d+\.\d\d ms per scan\n$", capsys.readouterr().out)


@pytest.mark.parametrize("line", shell_lines())
def test_the_commands_parse(line):
    words = shlex.split(line)[1:]
    name = "studyreport" if words[:2] == ["study", "report"] else words[0].replace("-", "")
    assert type(parse(words)).__name__.lower() == name


def test_many_runs_run(capsys):
    exec(compile(block_after("many"), "README.md", "exec"), {})
    assert re.search(r"^\(4, 3, \d+, 3\) ManyResult\(4 configurations × 3 keys", capsys.readouterr().out)


def test_the_study_can_be_read(tmp_path):
    path = tmp_path / "hall.toml"
    path.write_text(block_after("study"), encoding="utf-8")
    plan = read_plan(path)
    assert plan.space.parameters[0].name == "proposal.kind"
    assert len(plan.space.parameters) == 4


def test_ci_runs_the_two_commands_of_the_first_screen():
    script = ROOT / ".ci" / "run"
    if not script.exists():
        pytest.skip("a source distribution has no .ci/run")
    printed = subprocess.run([script, "--print"], capture_output=True, text=True, check=True).stdout
    assert printed == block_after("ci: main-job") + block_after("ci: tests")
