"""The help of `maira-qp` itself: which commands there are, what their exit codes mean."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, TextIO

from maira_qp.apps.arguments.optional import details, summary

if TYPE_CHECKING:
    from rich.console import Console

GROUPS = {
    "joint values": ("solve", "track", "fk"),
    "robots and pictures": ("robots", "view", "plot", "urdf"),
    "many poses": ("reach", "place", "dataset", "job"),
    "comparisons": ("compare", "bench"),
    "this installation": ("doctor", "compile", "cache"),
}
CODES = {
    "0": "done; of solve and track: solved, or followed whole",
    "1": "not solved, or not followed whole; of doctor: a fault; of job: not finished, or damaged; of place: no base "
    "reaches all",
    "2": "wrong use: the reason is on stderr",
    "3": "proved to be out of reach",
    "4": "neither: the budget was spent",
    "5": "some rows of a file hold no pose",
    "6": "no configuration within further limits was found",
    "130": "interrupted (Ctrl-C); 143: terminated",
    "141": "the reader of the output went away before the outcome was known",
}
FIRST = (
    "maira-qp solve --position 0.4 0.2 0.9 --rpy 180 0 0 --deg",
    "maira-qp view --robot panda",
)
WIDEST, INDENT = 100, 11
"""Columns at most, and those of names."""


def print_overview(commands: Mapping[str, type], stream: TextIO) -> None:
    """Print the table of all commands, by their names, in as many columns as the terminal has."""
    from maira_qp.apps.arguments.output import console_of_help

    out = console_of_help(stream, WIDEST)
    out.print("usage: maira-qp COMMAND [FLAGS]")
    out.print("       maira-qp COMMAND --help      what a command does, and its flags")
    out.print("       maira-qp --version", highlight=False)
    out.print()
    out.print(
        "Joint angles that put a robot's tool where it is wanted, within hard joint limits. Lengths are in metres, "
        "angles in radians (--mm, --deg: millimetres, degrees), times in seconds; quaternions are W X Y Z."
    )
    for heading, names in GROUPS.items():
        _print_rows(out, heading, {name: summary(commands[name]) for name in names})
    _print_rows(out, "exit codes", CODES)
    out.print("\n[bold]to begin with[/]")
    for line in FIRST:
        out.print(f"  {line}", soft_wrap=True)
    out.print("\nShell completion: maira-qp --tyro-print-completion bash (zsh, fish)")


def _print_rows(out: Console, heading: str, rows: Mapping[str, str]) -> None:
    """A heading, and two columns below it."""
    out.print(f"\n[bold]{heading}[/]")
    for name, words in rows.items():
        wrapped = textwrap.wrap(words, out.width - INDENT)
        out.print("\n".join([f"  {name:<{INDENT - 2}}{wrapped[0]}", *(" " * INDENT + each for each in wrapped[1:])]))


def print_details(kind: type) -> None:
    """Print what there is to say of a command below its flags."""
    if text := details(kind):
        print(text)  # noqa: T201
