"""Sentences whose lengths and angles can be had in other units."""

import json
import pickle

import numpy as np

import maira_qp as mq
from maira_qp.wording import Quantity, SentenceUnits, Wording, figures, fixed, in_units, joined

MILLIMETRES = SentenceUnits(length=lambda metres: f"{1e3 * metres:.0f} mm")
BOTH = SentenceUnits(MILLIMETRES.length, lambda radians: f"{radians:.1f} rad")
AWAY, TURN = Quantity(1.5, "m", "1.5 m"), Quantity(0.1, "rad", "5.73 degrees")


def test_numbers_have_no_sign_before_zeros_and_no_powers_of_ten_where_people_read_thousands():
    assert [fixed(value, 3) for value in (-1e-9, -0.0, -0.0006, 2, np.nan, -np.inf)] == [
        *("0.000", "0.000", "-0.001", "2.000", "nan", "-inf")
    ]
    assert [fixed(value, 1, "+") for value in (-0.04, 0.26, -3.0)] == ["+0.0", "+0.3", "-3.0"]
    assert [figures(value) for value in (0.012345, 999.4, 999.6, -12345.6, 1e-9, np.inf, 3e12)] == [
        *("0.0123", "999", "1,000", "-12,346", "1e-09", "inf", "3e+12")
    ]


def test_a_wording_is_a_text_and_knows_its_quantities_when_it_is_put_into_another():
    off = joined(" and ", [AWAY, TURN])
    all_of_it = Wording("It is ", off, " away, ", Quantity(0.5, "m/s", "0.5 m/s"))
    assert all_of_it == "It is 1.5 m and 5.73 degrees away, 0.5 m/s"
    assert in_units(all_of_it, SentenceUnits()) == all_of_it
    assert in_units(all_of_it, MILLIMETRES) == "It is 1500 mm and 5.73 degrees away, 500 mm/s"
    assert in_units(pickle.loads(pickle.dumps(all_of_it)), BOTH) == "It is 1500 mm and 0.1 rad away, 500 mm/s"
    assert json.loads(json.dumps({"why": all_of_it})) == {"why": all_of_it}
    assert joined(", ", []) == ""
    assert in_units("2 m, as text", MILLIMETRES) == "2 m, as text"


def test_what_is_said_of_answers_and_paths_can_be_had_in_other_units(maira):
    solver = mq.Solver(maira)
    far = solver.solve(mq.pose([1.5, 0.0, 1.5]))
    assert "would be 1.774 m from the shoulder, where the arm spans at most 1.4 m; " in str(far.explain())
    said = in_units(far.explain().words, BOTH)
    assert (
        "would be 1774 mm from the shoulder, where the arm spans at most 1400 mm; the answer is 362 mm and 0." in said
    )
    assert "degrees" not in said
    folded = in_units(solver.solve(mq.pose([0.1, 0.0, 0.438])).proof.words, BOTH)
    assert folded == "the elbow, joint4, would have to be at -2.9 rad or 2.9 rad, outside its limits"
    path = solver.track([mq.pose([0.6, 0, 0.6]), mq.pose([-0.6, 0, 0.6])])
    assert "; 0.5 rad is allowed" in path.reason
    in_degrees = in_units(path.reason, SentenceUnits(angle=lambda radians: f"{57.29578 * radians:.1f} deg"))
    assert "; 28.6 deg is allowed" in in_degrees
