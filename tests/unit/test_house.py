"""The house itself: small rooms, no circles, and tests that come in by the door."""

import ast
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import maira_qp

TESTS = Path(__file__).parents[1]
PACKAGE = Path(maira_qp.__file__).parent
MODULES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in PACKAGE.rglob("*.py")
}
PROTOCOLS = ("_asdict", "_fields", "_make", "_replace", "_repr_html_")
"""Names with an underscore that are public all the same: of named tuples, and IPython's."""


@cache
def nodes(path: Path) -> list[ast.AST]:
    """All that a file's text is made of and that the tests here look at."""
    kinds = ast.Import, ast.ImportFrom, ast.Attribute
    return [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, kinds)]


def imports(path: Path) -> set[str]:
    """The package's modules that a file imports: lazily and for types alone too."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in MODULES else str(node.module))
    return found & set(MODULES)


def reachable(graph: dict[str, set[str]], start: str) -> set[str]:
    """The modules that a module imports, and those that they import, and so on."""
    found, ahead = set(), list(graph[start])
    while ahead:
        name = ahead.pop()
        if name not in found:
            found.add(name)
            ahead += graph[name]
    return found


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """The sets of modules that import each other, directly or not."""
    below = {name: reachable(graph, name) for name in graph}
    found = []
    for name in graph:
        if name in below[name] and not any(name in circle for circle in found):
            found.append({other for other in below[name] if name in below[other]})
    return found


def private_attributes(path: Path) -> list[str]:
    """Where a file reaches for what is private: an attribute of anything but self and cls, or an import."""
    found = []
    for node in nodes(path):
        if isinstance(node, ast.Attribute) and not (
            isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
        ):
            found.append((node.lineno, node.attr))
        elif isinstance(node, ast.ImportFrom):
            found += [(node.lineno, alias.name) for alias in node.names]
    return [
        f"{path.relative_to(TESTS)}:{line}: {name}"
        for line, name in found
        if name.startswith("_") and not name.startswith("__") and name not in PROTOCOLS
    ]


def test_no_folder_holds_more_files_than_a_reader_takes_in_at_a_glance():
    counts = Counter(path.parent.relative_to(PACKAGE).as_posix() for path in MODULES.values())
    assert {folder: count for folder, count in counts.items() if count > 16} == {}


def test_no_modules_import_each_other():
    assert circles({name: imports(path) for name, path in MODULES.items()}) == []


def test_circles_are_found_whole_and_once():
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": {"e"}, "e": set(), "f": {"f", "a"}}
    assert circles(graph) == [{"a", "b", "c"}, {"f"}]


def test_tests_use_the_package_as_anyone_would():
    assert [place for path in sorted(TESTS.rglob("*.py")) for place in private_attributes(path)] == []


def test_tests_import_nothing_from_each_other():
    names = {path.stem for path in TESTS.rglob("*.py")} - {path.stem for path in (TESTS / "support").glob("*.py")}
    found = [
        f"{path.relative_to(TESTS)}:{node.lineno}: {node.module}"
        for path in sorted(TESTS.rglob("*.py"))
        for node in nodes(path)
        if isinstance(node, ast.ImportFrom) and node.module in names
    ]
    assert found == []


def test_the_package_is_light_to_import():
    """Numba, qpsolvers, plots and the viewer come with what needs them."""
    heavy = ("numba", "qpsolvers", "matplotlib", "viser")
    code = f"import sys, maira_qp; print([name for name in {heavy!r} if name in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "[]\n"
