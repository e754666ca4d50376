"""`help()` of data classes shows what their fields are."""

import inspect
import pydoc
from dataclasses import fields, is_dataclass

import pytest

import maira_qp as mq

CLASSES = [each for each in (getattr(mq, name) for name in mq.__all__) if isinstance(each, type) and is_dataclass(each)]


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_each_public_field_is_in_help(kind):
    told = " ".join(inspect.getdoc(kind).split())
    source = " ".join(
        " ".join(inspect.getsource(each)) if False else inspect.getsource(each)
        for each in kind.__mro__[:-1]
        if is_dataclass(each)
    )
    for field in fields(kind):
        if not field.name.startswith("_") and field.name not in ("name", "_"):
            assert f" {field.name}: " in told or f"{field.name}:" in source


def test_help_of_a_limit_says_what_is_kept_and_hides_the_rest():
    text = pydoc.plain(pydoc.render_doc(mq.CollisionLimit))
    assert "margin: Distance that every pair keeps [m]" in text
    assert "_scene:" not in inspect.getdoc(mq.CollisionLimit)


def test_inherited_fields_and_instances_show_them_too():
    assert "priority: Its level" in inspect.getdoc(mq.PositionTask)
    assert "frame: The frame's name" in mq.PositionTask().__doc__
