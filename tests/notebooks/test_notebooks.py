"""The notebooks run from top to bottom with small sizes, and are stored clean."""

import json
import os
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
ALL = sorted(NOTEBOOKS.glob("*.ipynb"))
SECONDS_PER_CELL = 300
"""For a machine that runs many tests at once; alone, a whole notebook takes less than 60."""
every_notebook = pytest.mark.parametrize("path", ALL, ids=lambda path: path.stem)


def execute(path: Path, folder: Path, **environment: str) -> nbformat.NotebookNode:
    """Return an executed copy of a notebook from a fresh kernel; raise the error of a cell that fails.

    Args:
        path: file of the notebook.
        folder: folder for the files of IPython, used by this kernel only.
        environment: environment variables in addition to the variables of this process.
    """
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(
        notebook,
        timeout=SECONDS_PER_CELL,
        kernel_name="python3",
        resources={"metadata": {"path": str(NOTEBOOKS)}},
    )
    # The kernel uses the backend of notebooks, not the backend of this process.
    inherited = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    client.execute(env={**inherited, "JAXSLAM_SMALL": "1", "IPYTHONDIR": str(folder), **environment})
    return notebook


def printed(notebook: nbformat.NotebookNode, stream: str) -> str:
    """Return everything that the notebook wrote to "stdout" or "stderr"."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return "".join(o.text for o in outputs if o.output_type == "stream" and o.name == stream)


def test_there_are_notebooks():
    numbers = [path.name[:2] for path in ALL]
    assert len(numbers) > 5
    assert len(set(numbers)) == len(numbers)


@every_notebook
def test_it_runs_and_does_not_warn(path, tmp_path):
    notebook = execute(path, tmp_path)
    # A kernel writes all warnings there, also the warnings of plots.
    assert printed(notebook, "stderr") == ""
    pictures = [
        o for cell in notebook.cells for o in cell.get("outputs", []) if "image/png" in o.get("data", {})
    ]
    assert pictures


def test_without_the_real_log_the_notebook_says_where_to_put_it(tmp_path):
    notebook = execute(NOTEBOOKS / "02_real_log.ipynb", tmp_path, JAXSLAM_DATA=str(tmp_path / "nothing"))
    said = printed(notebook, "stdout")
    assert f"put intel.clf.gz and intel.relations into {tmp_path / 'nothing' / 'carmen'}" in said
    assert "simulated hall" in said


@every_notebook
def test_it_is_stored_without_output_and_front_end(path):
    content = json.loads(path.read_text(encoding="utf-8"))
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert (content["nbformat"], content["nbformat_minor"]) == (4, 5)
    assert set(notebook.metadata) == {"kernelspec"}
    assert notebook.metadata.kernelspec.name == "python3"
    assert len({cell.id for cell in notebook.cells}) == len(notebook.cells)
    for cell in notebook.cells:
        assert cell.metadata == {}
        if cell.cell_type == "code":
            assert (cell.outputs, cell.execution_count) == ([], None)


@every_notebook
def test_it_has_a_title_and_a_small_version_and_is_listed(path):
    first, *rest = nbformat.read(path, as_version=4).cells
    assert first.cell_type == "markdown"
    assert first.source.startswith("# ")
    switch = 'SMALL = bool(os.environ.get("JAXSLAM_SMALL"))'
    assert any(switch in cell.source for cell in rest if cell.cell_type == "code")
    assert f"]({path.name})" in (NOTEBOOKS / "README.md").read_text(encoding="utf-8")
