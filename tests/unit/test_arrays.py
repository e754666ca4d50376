"""What a caller passes as numbers: taken where it is meant so, else refused by its name, its type and what is valid."""

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.arrays import real_array
from maira_qp.errors import ConfigurationError, PoseError


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        ("hi", "str: 'hi'"),
        (None, "NoneType: None"),
        (True, "bool: True"),
        (1j, "complex: 1j"),
        ({1}, "set: {1}"),
        ({"a": 1}, "dict: {'a': 1}"),
        ((x for x in (1, 2)), "generator: <generator"),
        (["1", "2"], "list of str: ['1', '2']"),
        ((1.0, None), "tuple of NoneType"),
        (np.array([1, "x"], dtype=object), "ndarray of str"),
        (np.array([True, False]), "ndarray of bool"),
        ([[1.0, 2.0], [3.0]], "entries of different lengths"),
        (0.5, "the one number 0.5"),
        ([1.0], "list of shape (1,)"),
        (np.ones((2, 1)), "ndarray of shape (2, 1)"),
        ([10**400, 1], "beyond the largest float"),
    ],
)
def test_what_is_no_array_is_refused_by_its_type_and_with_the_shape_that_is_valid(value, kind):
    """Never by NumPy's names for it, such as str64 and object."""
    with pytest.raises(ConfigurationError) as told:
        real_array(value, (2,), "speed", ConfigurationError)
    assert str(told.value).startswith(f"speed must be real numbers of shape (2,), not {kind}")
    assert "\n" not in str(told.value)


def test_whole_numbers_beyond_64_bits_are_numbers():
    assert real_array([10**30, 0.5], (2,), "speed", ConfigurationError).tolist() == [1e30, 0.5]
    assert real_array(10**30, (), "speed", ConfigurationError) == 1e30


@pytest.mark.parametrize("make", ["solve", "solve_batch", "task", "sphere", "mesh"])
@pytest.mark.parametrize("value", [[0.4, 0.0, 0.5], [0.4, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0], "hi", np.eye(3)])
def test_what_is_no_pose_is_refused_with_what_to_type_for_one(make, value):
    """A position too, but for bodies: a pose is made of it by a call that the message spells out, and that works."""
    if make in ("sphere", "mesh") and np.shape(value) == (3,):
        pytest.skip("a body stands at a point as well")
    solver = mq.Solver(mq.Robot.maira())
    places = {
        "solve": solver.solve,
        "solve_batch": lambda target: solver.solve_batch([target]),
        "task": lambda target: mq.PoseTask(target=target),
        "sphere": lambda pose: mq.Sphere(0.1, pose),
        "mesh": lambda pose: mq.Mesh("none.stl", pose=pose),
    }
    with pytest.raises(PoseError, match=r"(target|pose).* must be a pose .*mq\.pose\(\[x, y, z\]\)"):
        places[make](value)
    mq.Sphere(0.1, mq.pose([0.4, 0.0, 0.5]))
