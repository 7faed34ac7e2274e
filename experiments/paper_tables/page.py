"""The page that compares the results of the experiments with the papers."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from experiments._harness.results import Results, Table, read_results
from experiments.paper_tables.catalogue import EXPERIMENTS, FOLDER, Experiment
from experiments.paper_tables.papers import PAPERS, Item, Paper

PAGE = "PAPERS.md"
_HEAD = f"""# Results beside the papers

Each table compares the figures, tables and numbers of a paper with the results of this project. Numbers over
seeds are mean ± standard deviation (worst). Full references: [bibliography](../docs/bibliography.md).
`python -m experiments page` generates this page from the results: edit `experiments/paper_tables/papers.py`
and not `{PAGE}`.

The page omits figures 1 to 3 of Liang et al., figures 1 to 6 of Yang et al. 2019, and figures 1 to 7 and
table I of Jamaludin et al., which show methods and robots instead of results. Figure 19 of Jamaludin et al.
plots the inliers of table II. Their figures 20 and 21, two maps with 42 and 77 inliers, have no counterpart.
"""


@dataclass(frozen=True)
class _Found:
    """The results of the experiment of one paper.

    Attributes:
        experiment: the experiment.
        root: the folder with the page and with the folders of the experiments.
        results: the results as read.
        tables: the tables of the results, by title.
    """

    experiment: Experiment
    root: Path
    results: Results
    tables: dict[str, Table]

    @property
    def done(self) -> bool:
        return self.results.text is not None

    def path(self, name: str) -> Path:
        return self.experiment.results(self.root) / name

    def link(self, name: str) -> str:
        """Return a link from the page to a file of the results, or a note that the file does not exist."""
        if not self.path(name).exists():
            return f"`{name}`: not available yet"
        return f"[{name}]({self.path(name).relative_to(self.root).as_posix()})"


def write_page(root: Path = FOLDER) -> list[str]:
    """Write the page; return one line for each result that is missing.

    Raises:
        ValueError: a file of the results is invalid.
        OSError: a file cannot be read, or the page cannot be written.
    """
    text = render(root)
    (root / PAGE).write_text(text, encoding="utf-8")
    return [line for paper in PAPERS for line in _missing(paper, _find(paper, root))]


def render(root: Path = FOLDER) -> str:
    """Return the page as Markdown, with links relative to `root`.

    Raises:
        ValueError: a file of the results is invalid.
        OSError: a file cannot be read.
    """
    parts = [_HEAD]
    for paper in PAPERS:
        found = _find(paper, root)
        parts += [_introduction(paper, found), _comparison(paper, found)]
        if found.done:
            parts += [*_figures(paper, found), _all_tables(found)]
    return "\n".join(parts)


def _find(paper: Paper, root: Path) -> _Found:
    experiment = EXPERIMENTS[paper.experiment]
    results = read_results(experiment.results(root))
    return _Found(experiment, root, results, results.tables)


def _missing(paper: Paper, found: _Found) -> Iterator[str]:
    name, command = found.experiment.name, found.experiment.command
    if not found.done:
        yield f"{name}: no results yet: {command}"
        return
    for item in paper.items:
        for file in item.files:
            if not found.path(file).exists():
                yield f"{name}: {file} ({item.name}) is missing: {command}"


def _introduction(paper: Paper, found: _Found) -> str:
    name = found.experiment.name
    command = found.results.origin.get("command") or found.experiment.command
    if found.done:
        made = [found.results.made_by or "`run.json`, the record of command and versions, is missing"]
        if found.path("cells.json").exists():
            made.append(f"the settings of each cell are in {found.link('cells.json')}")
        state = "; ".join(made) + "."
    else:
        state = (
            f"**No results yet:** the experiment has not been completed. The command takes about "
            f"{found.experiment.hours:g} hours."
        )
    return (
        f"## {paper.name}: {paper.title}\n\n{paper.note}\n\n"
        f"Experiment: [{name}]({name}/README.md), `{command}`. {state}\n"
    )


def _comparison(paper: Paper, found: _Found) -> str:
    rows = ["| in the paper | content | jaxslam | files |", "|---|---|---|---|"]
    for item in paper.items:
        ours = "<br>".join(_quotes(item, found)) if found.done else "not available yet"
        files = "<br>".join(found.link(file) for file in item.files)
        rows.append(f"| {item.name} | {item.shows} | {ours} | {files} |")
    return "\n".join(rows) + "\n"


def _quotes(item: Item, found: _Found) -> Iterator[str]:
    for quote in item.ours:
        try:
            yield quote.read(found.tables)
        except KeyError as error:
            # Results with fewer seeds or other methods lack the row.
            yield f"no {error} in `table.md`: `{found.experiment.command}`"


def _figures(paper: Paper, found: _Found) -> Iterator[str]:
    for item in paper.items:
        for file in item.files:
            if file.endswith(".png") and found.path(file).exists():
                path = found.path(file).relative_to(found.root).as_posix()
                yield f"**{item.name}**, `{file}`:\n\n![{item.name}]({path})\n"


def _all_tables(found: _Found) -> str:
    text = (found.results.text or "").strip()
    return f"<details>\n<summary>All tables of {found.experiment.name}</summary>\n\n{text}\n\n</details>\n"
