"""The gallery of the documentation site: each example with its first sentence, its picture and its text."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from PIL import Image

PICTURES = "images/examples"
"""Folder in docs/ with the pictures that the examples draw: `make gallery` renews them."""


SIZE = 900
"""The longer side of a picture [pixels]."""


class Example(NamedTuple):
    """A script of examples/."""

    name: str
    title: str
    rest: str
    """What its docstring says after the first sentence."""
    picture: str
    """Its picture, relative to docs/; empty: none."""
    text: str


def examples(root: Path) -> list[Example]:
    """All of them, in their order."""
    return [example(root, path) for path in sorted((root / "examples").glob("[0-9]*.py"))]


def example(root: Path, path: Path) -> Example:
    """One of them."""
    text = path.read_text(encoding="utf-8")
    words = ast.get_docstring(ast.parse(text)) or ""
    title, _, rest = words.partition("\n\n")
    pictures = sorted((root / "docs" / PICTURES).glob(f"{path.stem[:2]}_*"))
    picture = pictures[-1].relative_to(root / "docs").as_posix() if pictures else ""
    return Example(path.stem, " ".join(title.split()), rest, picture, text)


def cards(root: Path) -> str:
    """The gallery's page: a card for each example."""
    return f'<div class="gallery">\n{"".join(map(card, examples(root)))}</div>'


def card(example: Example) -> str:
    """An example in the gallery."""
    picture = f'<img src="../{example.picture}" alt="" loading="lazy">' if example.picture else ""
    title = re.sub(r"`(.*?)`", r"<code>\1</code>", example.title)
    return f'<a href="{example.name}.html">{picture}<p>{title}</p></a>\n'


def files(root: Path) -> Iterator[tuple[str, str]]:
    """The page of each example, by its address."""
    for example in examples(root):
        picture = f"![](../{example.picture})\n\n" if example.picture else ""
        title = example.name.partition("_")[2].replace("_", " ").capitalize()
        yield (
            f"examples/{example.name}.md",
            f"# {title}\n\n{example.title}\n\n{example.rest}\n\n{picture}`python examples/{example.name}.py`\n\n"
            f"```python\n{example.text}```\n",
        )


def renew(root: Path) -> None:
    """Copy the pictures that the examples have drawn into the gallery, in the size that a page shows."""
    folder = root / "docs" / PICTURES
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted((root / "output").glob("[0-9][0-9]_*.png")):
        with Image.open(path) as picture:
            picture.thumbnail((SIZE, SIZE))
            picture.convert("RGB").quantize(64).save(folder / path.name, optimize=True)


if __name__ == "__main__":
    renew(Path(__file__).parents[2])
