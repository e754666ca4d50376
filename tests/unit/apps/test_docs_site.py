"""The documentation site names everything public, describes every parameter, and fetches nothing."""

import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import maira_qp as mq

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
API = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "api").glob("*.md"))
HIDDEN = re.findall(r'- "!(.*)"$', (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), flags=re.MULTILINE)
SHOWN = set(re.findall(r"^::: maira_qp\.(\S+)$", API, flags=re.MULTILINE))


@pytest.mark.parametrize("name", mq.__all__)
def test_the_reference_shows_what_is_public(name):
    assert name in SHOWN


def test_the_reference_shows_nothing_else():
    assert {name for name in SHOWN - set(mq.__all__) if not name.startswith("integrations")} == {
        "apps.plots",
        "apps.notebook",
    }


def entries() -> Iterator[tuple[str, Callable, str]]:
    """What a user calls: functions, constructors and the methods that a class itself defines, with their words."""
    for name in mq.__all__:
        thing = getattr(mq, name)
        if inspect.ismodule(thing):
            members = [(f"{name}.{each}", getattr(thing, each)) for each in getattr(thing, "__all__", dir(thing))]
            yield from ((place, f, inspect.getdoc(f) or "") for place, f in members if inspect.isfunction(f))
        elif inspect.isclass(thing):
            about = inspect.getdoc(thing) or ""
            for key, member in vars(thing).items():
                function = getattr(member, "__func__", member)
                if inspect.isfunction(function) and is_shown(key) and "at" not in signature(function):
                    yield f"{name}.{key}", function, f"{inspect.getdoc(function)} {about}"
        else:
            yield name, thing, inspect.getdoc(thing) or ""


def is_shown(name: str) -> bool:
    """Whether the reference shows a member of this name: the rest is for authors of tasks and limits."""
    return not any(re.search(hidden, name) for hidden in HIDDEN)


def signature(function: Callable) -> list[str]:
    """The names of a function's parameters; methods with `at` are for authors of tasks and limits."""
    return list(inspect.signature(function).parameters)


@pytest.mark.parametrize(("place", "function", "words"), [pytest.param(*entry, id=entry[0]) for entry in entries()])
def test_every_parameter_is_described(place, function, words):
    names = [name for name in signature(function) if name not in ("self", "cls")]
    assert [name for name in names if not re.search(rf"\b{name}\b", words)] == []


def test_every_page_stands_in_the_menu():
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = [path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")]
    assert [page for page in pages if page not in menu] == []


def test_every_example_has_its_picture_in_the_gallery():
    """`make gallery` copies what the examples have drawn."""
    drawing = [path for path in (ROOT / "examples").glob("[0-9]*.py") if "output/" in path.read_text(encoding="utf-8")]
    assert [path.name for path in drawing if not list((DOCS / "images" / "examples").glob(f"{path.stem[:2]}_*"))] == []
    assert len(drawing) > 10


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


@pytest.mark.parametrize("page", [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))], ids=lambda page: page.name)
def test_no_word_must_be_guessed(page):
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"\b(?:felt|told|to the bit|a pose a row|a row an answer|weights an axis)\b", text) == []
