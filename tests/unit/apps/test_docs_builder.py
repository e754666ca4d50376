"""What the documentation's builder makes of the code: docstrings, parameters, formulas, the gallery, the house."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

pytest.importorskip("mkdocs")
pytest.importorskip("griffe")
pytest.importorskip("latex2mathml")

ROOT = Path(__file__).parents[3]
BUILDER = ROOT / "docs" / "builder"
PAGES = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))


def builder(name: str) -> ModuleType:
    """A module of docs/builder."""
    if str(BUILDER) not in sys.path:
        sys.path.append(str(BUILDER))
    spec = importlib.util.spec_from_file_location(name, BUILDER / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_entry_of_several_parameters_is_one_for_each():
    parameters = builder("parameters")
    words = "Args:\n    q0: a start.\n    step, turn: largest\n        distances.\n    dt: time.\n"
    assert parameters.ENTRY.sub(parameters.split, words) == (
        "Args:\n    q0: a start.\n    step: largest\n        distances.\n    turn: see `step`.\n    dt: time.\n"
    )


@pytest.mark.parametrize("module", sorted(set(re.findall(r"<!-- docstring (\S+) -->", PAGES))))
def test_the_docstrings_that_pages_show_are_there(module):
    assert module.rpartition(".")[2] in builder("hooks").docstring(module)


def test_a_module_without_a_docstring_is_a_fault(monkeypatch, tmp_path):
    hooks = builder("hooks")
    (tmp_path / "silent.py").write_text("x = 1\n")
    monkeypatch.setattr(hooks, "ROOT", tmp_path)
    with pytest.raises(hooks.PluginError, match="silent"):
        hooks.docstring("silent")


def test_formulas_become_mathml():
    html = '<span class="arithmatex">\\(q &lt; u\\)</span><div class="arithmatex">\\[\\frac{1}{2}\\]</div>'
    made = builder("hooks").on_page_content(html, None, None, None)
    assert made.count("<math") == 2
    assert '<div class="formula"><math' in made  # which scrolls where it is wider than the page
    assert "arithmatex" not in made
    assert "<mfrac>" in made


@pytest.mark.parametrize(
    "fetching",
    [
        '<script async src="https://elsewhere.example/x.js"></script>',
        '<link rel="stylesheet" href="//elsewhere.example/x.css">',
        '<img alt="" src="http://elsewhere.example/x.png">',
    ],
)
def test_a_page_that_fetches_from_elsewhere_is_refused(fetching):
    hooks, page = builder("hooks"), SimpleNamespace(file=SimpleNamespace(src_uri="page.md"))
    kept = '<img src="images/x.png"><a href="https://elsewhere.example">a link is fine</a>'
    assert hooks.on_post_page(kept, page, None) == kept
    with pytest.raises(hooks.PluginError, match=r"page\.md fetches"):
        hooks.on_post_page(kept + fetching, page, None)


def test_the_gallery_shows_every_example():
    gallery = builder("gallery")
    scripts = {path.stem for path in (ROOT / "examples").glob("[0-9]*.py")}
    assert {example.name for example in gallery.examples(ROOT)} == scripts
    assert all(example.title for example in gallery.examples(ROOT))
    assert {uri for uri, _ in gallery.files(ROOT)} == {f"examples/{name}.md" for name in scripts}


def test_the_house_has_every_room_with_its_purpose():
    house = builder("house")
    rooms = {room for floor in house.floors() for room in floor}
    folders = {path.parent.name for path in (ROOT / "maira_qp").glob("*/__init__.py")}
    assert folders <= rooms
    assert all(house.purpose(room) for room in rooms)


def test_links_of_pages_lead_to_files_of_the_repository():
    """Where pages are read there, before a site is built."""
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    assert len(pages) > 40
    for page in pages:
        for link in re.findall(r"\]\(([^)\s#]+)[^)\s]*\)", page.read_text(encoding="utf-8")):
            if "://" not in link and not link.startswith("mailto:"):
                assert (page.parent / link).exists(), f"{page.relative_to(ROOT)} -> {link}"


def test_such_links_become_those_of_the_site():
    with_links_of_site = builder("hooks").with_links_of_site
    assert with_links_of_site("[a](../../examples/07_dual_arm.py)") == "[a](../examples/07_dual_arm.md)"
    assert with_links_of_site("[a](../examples/07_dual_arm.py)") == "[a](examples/07_dual_arm.md)"
    assert with_links_of_site("![](../../benchmarks/peers.png)") == "![](../images/peers.png)"
    assert with_links_of_site("![a](../images/figures/boxes.png)") == "![a](../figures/boxes.svg)"
    for kept in ("[a](paths.md#time-a-path)", "![](../images/viewer.png)", "`../../examples/07_dual_arm.py`"):
        assert with_links_of_site(kept) == kept


def test_each_figure_of_the_site_is_in_the_repository():
    pytest.importorskip("matplotlib")
    kept = {path.stem for path in (ROOT / "docs" / "images" / "figures").glob("*.png")}
    assert {draw.__name__ for draw in builder("figures").FIGURES} == kept
