"""What the site has beyond the pages in this folder: notebooks, API pages, changelog, formulas as MathML."""

import html
import os
import pkgutil
import re
from pathlib import Path
from typing import Any

import nbformat
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbconvert import MarkdownExporter
from nbconvert.preprocessors import ExecutePreprocessor
from traitlets.config import Config

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
# A notebook links to files of the repository: pages of the site under another path, or not part of the site.
_LINKS = {
    r"\]\(\.\./docs/": "](../",
    r"\]\((\w+)\.ipynb\)": r"](\1.md)",
    r"\[([^]]+)\]\(\.\./experiments/[^)]+\)": r"\1",
}
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def packages() -> list[str]:
    """Return the packages of jaxslam, the top one first, without importing them."""
    found = pkgutil.iter_modules([str(ROOT / "jaxslam")], "jaxslam.")
    return ["jaxslam", *sorted(module.name for module in found if module.ispkg)]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages, and the pages whose source is outside this folder."""
    for path in NOTEBOOKS:
        text, pictures = _render_notebook(path)
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=text))
        for name, content in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=content))
    files.append(File.generated(config, "changelog.md", abs_src_path=str(ROOT / "CHANGELOG.md")))
    for name in packages():
        files.append(File.generated(config, f"api/{name}.md", content=_api_page(name)))
    # They stand between the formats and the bibliography.
    notebooks = [f"notebooks/{path.stem}.md" for path in NOTEBOOKS]
    api = [{name: f"api/{name}.md"} for name in packages()]
    assert config.nav is not None
    config.nav[-2:-2] = [{"Notebooks": notebooks}, {"API reference": api}]
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Turn formulas into MathML, which browsers render without scripts and without a network."""
    return _FORMULA.sub(lambda found: _mathml(found[3], block=found[2] == "["), content)


def _render_notebook(path: Path) -> tuple[str, dict[str, bytes]]:
    """Return a notebook as Markdown, and its pictures by file name.

    The files store no output. With JAXSLAM_RUN_NOTEBOOKS in the environment, as for the deployed site, the
    notebook is executed first, in minutes; without it, the page shows the code and the text alone.
    """
    pictures = f"{path.stem}_{{cell_index}}_{{index}}{{extension}}"
    exporter = MarkdownExporter(
        config=Config(ExtractOutputPreprocessor={"output_filename_template": pictures})
    )
    notebook = nbformat.read(path, as_version=4)
    if os.environ.get("JAXSLAM_RUN_NOTEBOOKS"):
        context = {"metadata": {"path": str(path.parent)}}
        ExecutePreprocessor(timeout=1800, kernel_name="python3").preprocess(notebook, context)
    notebook.metadata.language_info = {"name": "python"}  # of the code blocks; the files do not store it
    text, resources = exporter.from_notebook_node(notebook)
    for link, here in _LINKS.items():
        text = re.sub(link, here, text)
    return text, resources["outputs"]


def _mathml(latex: str, *, block: bool) -> str:
    text = convert(html.unescape(latex).strip(), display="block" if block else "inline")
    # Browsers add no space between the name of a function and its argument.
    return re.sub(r"<mi>(log|exp|arg|max|min)</mi>", r'<mi>\1</mi><mspace width="0.17em"/>', text)


def _api_page(package: str) -> str:
    """Return the page of a package: its docstring, then its public modules in alphabetical order."""
    folder = ROOT / Path(*package.split("."))
    # The names of the top package are documented in the packages that define them.
    files = [] if package == "jaxslam" else sorted(folder.rglob("*.py"))
    modules = [
        file.relative_to(ROOT).with_suffix("").parts for file in files if not file.stem.startswith("_")
    ]
    public = [".".join(parts) for parts in modules if not any(part.startswith("_") for part in parts)]
    blocks = [f"# {package}\n\n::: {package}\n    options:\n      members: false\n"]
    blocks += [f"::: {name}\n    options:\n      show_root_heading: true\n" for name in public]
    return "\n".join(blocks)
