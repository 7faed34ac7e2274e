"""The page that has what the three papers show beside what came out here."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from experiments.catalogue import EXPERIMENTS, FOLDER, Experiment
from experiments.papers import PAPERS, Item, Paper
from experiments.results import Results, Table, read_results

PAGE = "PAPERS.md"
_HEAD = f"""# The three papers, table by table and figure by figure

What a paper shows and its numbers, beside the files here that show the same and our numbers. Numbers over
seeds are mean ± standard deviation (worst). `python -m experiments page` makes this page from the results;
edit `experiments/papers.py` and not `{PAGE}`.

It has everything that our notes on the papers name. Figures and tables before those (tobacco 1 to 3, mine 1
to 6, ann 1 to 7 and table I) are not in the notes: they are taken for drawings of methods and robots, no
results.
"""


@dataclass(frozen=True)
class _Found:
    """An experiment with what it left, for one paper.

    Attributes:
        experiment: which.
        root: the folder that has the experiments' folders, and the page.
        results: as read.
        tables: of the results, by title.
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
        """A link to a file of the results from the page, or that it is not there."""
        if not self.path(name).exists():
            return f"`{name}`: not there yet"
        return f"[{name}]({self.path(name).relative_to(self.root).as_posix()})"


def write_page(root: Path = FOLDER) -> list[str]:
    """Writes the page; returns what is missing on it, a line each.

    Raises:
        ValueError: a results file cannot be understood.
        OSError: a file cannot be read, or the page not be written.
    """
    text = render(root)
    (root / PAGE).write_text(text, encoding="utf-8")
    return [line for paper in PAPERS for line in _missing(paper, _look(paper, root))]


def render(root: Path = FOLDER) -> str:
    """The page as Markdown, with links that are right in `root`.

    Raises:
        ValueError: a results file cannot be understood.
        OSError: a file cannot be read.
    """
    parts = [_HEAD]
    for paper in PAPERS:
        found = _look(paper, root)
        parts += [_introduction(paper, found), _comparison(paper, found)]
        if found.done:
            parts += [*_figures(paper, found), _all_tables(found)]
    return "\n".join(parts)


def _look(paper: Paper, root: Path) -> _Found:
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
        made = [found.results.made_by or "`run.json`, which says what made the results, is missing"]
        if found.path("cells.json").exists():
            made.append(f"every setting of every cell in {found.link('cells.json')}")
        state = "; ".join(made) + "."
    else:
        state = (
            f"**No results yet:** the whole of it has not been run to its end. The command takes about "
            f"{found.experiment.hours:g} hours."
        )
    return (
        f"## {paper.name}: {paper.title}\n\n{paper.note}\n\n"
        f"Experiment: [{name}]({name}/README.md), `{command}`. {state}\n"
    )


def _comparison(paper: Paper, found: _Found) -> str:
    rows = ["| in the paper | what it shows | ours | where |", "|---|---|---|---|"]
    for item in paper.items:
        ours = "<br>".join(_quotes(item, found)) if found.done else "not there yet"
        files = "<br>".join(found.link(file) for file in item.files)
        rows.append(f"| {item.name} | {item.shows} | {ours} | {files} |")
    return "\n".join(rows) + "\n"


def _quotes(item: Item, found: _Found) -> Iterator[str]:
    for quote in item.ours:
        try:
            yield quote.read(found.tables)
        except KeyError as error:
            # Results of fewer seeds or of other methods than these have no such row.
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
