"""What the documentation site makes of the code while it is built: hooks of MkDocs.

Comments in a page stand for text that the code has already:

    <!-- docstring maira_qp.problem.qp.hierarchy -->    the docstring of a module
    <!-- engines -->                                    the two tables of `solvers/dispatch.py`
    <!-- gallery -->                                    the examples with their pictures
    <!-- text benchmarks/peers.txt -->                  a text file of the repository, as it is

Formulas become MathML, which browsers draw themselves. Figures are drawn by `figures.py`, in memory. Links of pages
lead to files of the repository, so that they work where pages are read there; the site has pages and figures in place
of these files.
"""

from __future__ import annotations

import ast
import html
import re
import sys
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]
FETCHED = re.compile(
    r'<(script|img|iframe|link rel="(stylesheet|preconnect|icon)")[^>]* (src|href)="(https?:)?//[^>]*>'
)
LINKS = {
    r"\]\(((?:\.\./)*)\.\./examples/(\w+)\.py": r"](\1examples/\2.md",
    r"\]\(((?:\.\./)*)\.\./benchmarks/(\w+\.png)": r"](\1images/\2",
    r"\]\(((?:\.\./)*)images/figures/(\w+)\.png": r"](\1figures/\2.svg",
}
"""Links as pages have them, which lead to files of the repository, and what they are on the site."""
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import figures  # noqa: E402
import gallery  # noqa: E402

from maira_qp.solvers import dispatch  # noqa: E402


def on_files(files, config):
    """Add what is made: figures, the pages of examples, the list of changes."""
    for name, picture in figures.drawn():
        files.append(File.generated(config, f"figures/{name}.svg", content=picture))
    for uri, content in gallery.files(ROOT):
        files.append(File.generated(config, uri, content=content))
    files.append(File.generated(config, "reference/changes.md", content=read("CHANGELOG.md")))
    for picture in sorted((ROOT / "benchmarks").glob("*.png")):
        files.append(File.generated(config, f"images/{picture.name}", content=picture.read_bytes()))
    return files


def on_page_markdown(markdown, page, config, files):
    """Put the code's own text where a comment stands for it, and let links lead to what is made."""
    markdown = with_links_of_site(markdown)
    return re.sub(r"<!-- (docstring|engines|gallery|text)\s?(\S*) -->", made, markdown)


def on_page_content(content, page, config, files):
    """Turn formulas into MathML."""
    content = re.sub(r'<span class="arithmatex">\\\((.*?)\\\)</span>', inline, content, flags=re.DOTALL)
    return re.sub(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', block, content, flags=re.DOTALL)


def on_post_page(output, page, config):
    """Refuse a page that would fetch something from elsewhere."""
    fetched = FETCHED.search(output)
    if fetched:
        raise PluginError(f"{page.file.src_uri} fetches from elsewhere: {fetched[0]}")
    return output


def with_links_of_site(markdown: str) -> str:
    """A page with links to what is made of files of the repository, in place of links to these files."""
    for of_repository, of_site in LINKS.items():
        markdown = re.sub(of_repository, of_site, markdown)
    return markdown


def made(match: re.Match) -> str:
    """What a comment stands for."""
    kind, argument = match.groups()
    if kind == "docstring":
        return docstring(argument)
    if kind == "engines":
        return dispatch.tables()
    if kind == "gallery":
        return gallery.cards(ROOT)
    return f"```text\n{read(argument)}\n```"


def docstring(module: str) -> str:
    """The docstring of a module, with the file that it stands in."""
    path = Path(*module.split("."))
    path = path / "__init__.py" if (ROOT / path).is_dir() else path.with_suffix(".py")
    text = ast.get_docstring(ast.parse(read(path)))
    if not text:
        raise PluginError(f"{path} has no docstring")
    return f'<div class="docstring" markdown>\n\n{text}\n\n<small>`{path}`</small>\n\n</div>'


def read(path: str | Path) -> str:
    """A text file of the repository."""
    return (ROOT / path).read_text(encoding="utf-8")


def inline(match: re.Match) -> str:
    """A formula within a line."""
    return convert(html.unescape(match[1]))


def block(match: re.Match) -> str:
    """A formula on a line of its own, which scrolls where the page is narrower."""
    return f'<div class="formula">{convert(html.unescape(match[1]), display="block")}</div>'
