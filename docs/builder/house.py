"""The house, drawn from the import contract in pyproject.toml: a room imports only what stands below it."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from maira_qp.apps import plots

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
FLOOR, WIDTH = 0.5, 9.0


def floors() -> list[list[str]]:
    """The rooms of each floor, from the roof down, as the contract names them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    return [[name.strip().removeprefix("maira_qp.") for name in layer.split("|")] for layer in layers]


def purpose(room: str) -> str:
    """The first sentence of a room's docstring."""
    path = ROOT / "maira_qp" / room
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    words = " ".join((ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n\n")[0].split())
    return words.split(". ")[0].split(":")[0].rstrip(".")


def house() -> Figure:
    """Draw it."""
    stack = floors()
    fig = Figure(figsize=(WIDTH, FLOOR * len(stack) + 0.3), layout="constrained")
    ax = fig.add_subplot()
    for level, rooms in enumerate(stack):
        width = WIDTH / len(rooms)
        for i, room in enumerate(rooms):
            x, y = i * width, (len(stack) - level) * FLOOR
            ax.add_patch(
                FancyBboxPatch(
                    (x + 0.06, y),
                    width - 0.12,
                    FLOOR * 0.82,
                    boxstyle="round,pad=0,rounding_size=0.06",
                    facecolor="#E8EEF2",
                    edgecolor=plots.COLORS[0],
                )
            )
            ax.text(x + 0.18, y + FLOOR * 0.52, room, fontsize=10, fontweight="bold", va="center")
            ax.text(
                x + 0.18,
                y + FLOOR * 0.22,
                shortened(purpose(room), int(15 * width)),
                fontsize=7.5,
                va="center",
                color="#333333",
            )
    ax.set(xlim=(0, WIDTH), ylim=(FLOOR * 0.8, FLOOR * (len(stack) + 1)))
    ax.axis("off")
    return fig


def shortened(text: str, size: int) -> str:
    """The beginning of a text that fits into a room."""
    return text if len(text) <= size else text[: size - 1].rsplit(" ", 1)[0].rstrip(",;") + " ..."
