"""The blocks of code in the Markdown files of the project."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
if not DOCS.is_dir():
    pytest.skip("a source distribution has no docs", allow_module_level=True)


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return re.findall(
        rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


def block_after(page: Path, marker: str) -> str:
    """The block under a comment such as `<!-- quickstart -->`."""
    found = re.search(
        rf"^<!-- {marker} -->\n```\w+\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    assert found is not None, f"{page}: no block under <!-- {marker} -->"
    return found[1]


def run_blocks(page: Path) -> dict[str, object]:
    """Run the Python blocks of a page one after the other; the names that they define."""
    code = blocks(page, "python")
    assert code, page
    names: dict[str, object] = {"__name__": "__main__"}
    for block in code:
        exec(compile(block, str(page), "exec"), names)
    return names


def commands(page: Path) -> list[str]:
    """The lines that start with `jaxslam`, without their comments and redirections."""
    lines = "".join(blocks(page, "sh")).splitlines()
    return [re.split(r"\s+(?:>|#) ", line)[0] for line in lines if line.startswith("jaxslam ")]
