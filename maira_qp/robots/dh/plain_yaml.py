"""YAML as data: mappings, lists, text, numbers, true, false and null; what only surprises is refused or read as text.

Numbers are those of YAML 1.2: 1e-3 is one, 010 is ten and 1:30 is text. Dates are text. A key given twice is an error,
and so are aliases that stand for more than a file of that size would hold if it were written out.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

MAX_NODES = 10_000
"""Most values of a file, each alias counted as all that it stands for."""
MAX_DEPTH = 20
"""Deepest nesting of values."""

_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_WHOLE = re.compile(r"[-+]?[0-9]+")


def plain_yaml(text: str) -> Any:
    """The value that a text in YAML holds. Raises `yaml.YAMLError`, `ValueError`, `RecursionError`."""
    return yaml.load(text, _Loader)


class _Loader(yaml.SafeLoader):
    """Counts what it composes, and knows few kinds of scalars."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._count = self._depth = 0
        self._sizes: dict[int, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        is_alias, before = self.check_event(yaml.AliasEvent), self._count
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise yaml.YAMLError(f"values are nested deeper than {MAX_DEPTH}")
        node = super().compose_node(parent, index)
        self._depth -= 1
        if is_alias and id(node) not in self._sizes:
            raise yaml.YAMLError("an alias stands within what it stands for")
        self._count += self._sizes[id(node)] if is_alias else 1
        if self._count > MAX_NODES:
            raise yaml.YAMLError(f"more than {MAX_NODES} values, aliases counted as what they stand for")
        self._sizes[id(node)] = self._count - before
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        if isinstance(node, yaml.MappingNode):
            keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode) and key.value != "<<"]
            for i, key in enumerate(keys):
                if key in keys[:i]:
                    raise yaml.YAMLError(f"the key {key!r} is given twice, line {node.start_mark.line + 1}")
        return super().construct_mapping(node, deep)


def _number(loader: _Loader, node: Any) -> int | float:
    text = loader.construct_scalar(node)
    return int(text) if _WHOLE.fullmatch(text) else float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))


_KEPT = ("tag:yaml.org,2002:bool", "tag:yaml.org,2002:null", "tag:yaml.org,2002:merge")
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag in _KEPT]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver("!number", re.compile(f"^(?:{_NUMBER.pattern})$"), list("-+.0123456789"))
_Loader.add_constructor("!number", _number)
