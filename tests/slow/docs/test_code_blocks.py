"""Code in README.md, in the documentation site and in docstrings runs as it stands."""

import ast
import re
import shlex
import textwrap
from pathlib import Path

import pytest

import maira_qp
from maira_qp.apps.cli import parse

ROOT = Path(__file__).parents[3]
PACKAGE = Path(maira_qp.__file__).parent
PAGES = ["README.md", *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
TEXTS = {page: (ROOT / page).read_text(encoding="utf-8") for page in PAGES}
BLOCKS = {page: BLOCK.findall(text) for page, text in TEXTS.items()}
COMMANDS = [
    line for text in TEXTS.values() for line in re.findall(r"^    (maira-qp [^|>\n]*)", text, flags=re.MULTILINE)
]
LANGUAGES = {"python", "toml", "text"}
"""`text` is for what is printed, and for files that are not read."""


def docstrings() -> dict[str, str]:
    """The docstrings of the package that hold code, by their places."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                text = ast.get_docstring(node) or ""
                if "```" in text or re.search(r"^ *import maira_qp|^ +.*\bmq\.", text, flags=re.MULTILINE):
                    found[f"{path.relative_to(PACKAGE.parent)}:{getattr(node, 'name', '')}"] = text
    return found


DOCSTRINGS = docstrings()


def run(blocks: list[tuple[str, str]], place: str) -> dict:
    """Run blocks from top to bottom in one namespace, as a reader types them; files are those that they show."""
    seen: dict = {"__name__": "page"}
    for language, text in blocks:
        if language == "toml":
            name, call = re.match(r"# (\S+\.toml): (mq\.[\w.]+\(.*?\)),", text).groups()
            Path(name).write_text(text)
            assert eval(call, seen).links
        elif language == "python":
            exec(compile(text, place, "exec"), seen)
    return seen


@pytest.mark.parametrize("page", [page for page in PAGES if any(kind == "python" for kind, _ in BLOCKS[page])])
def test_the_python_of_a_page_runs_from_top_to_bottom(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(BLOCKS[page], page)


@pytest.mark.parametrize("page", PAGES)
def test_every_block_says_what_it_is(page):
    assert {language for language, _ in BLOCKS[page]} <= LANGUAGES
    assert TEXTS[page].count("```") == 2 * len(BLOCKS[page])


@pytest.mark.parametrize("place", DOCSTRINGS)
def test_the_python_of_a_docstring_runs(place, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = BLOCK.findall(DOCSTRINGS[place])
    assert blocks, "code in a docstring stands between ```python and ```"
    run([(language, textwrap.dedent(text)) for language, text in blocks], place)


@pytest.mark.parametrize("line", COMMANDS)
def test_commands_have_the_flags_that_they_use(line):
    assert parse(shlex.split(line)[1:]) is not None


def test_pages_and_commands_are_found():
    assert len(PAGES) > 20
    assert len(COMMANDS) > 10
    assert DOCSTRINGS
