"""Messages of the library in the language of the command line: each names the flag that it is about."""

import pytest

from maira_qp.apps.arguments.naming import in_flags
from maira_qp.apps.cli import main

POSE = ("--position", "0.4", "0.2", "0.9")


@pytest.mark.parametrize(
    ("message", "arguments", "named"),
    [
        ("max_restarts must be 0 or more", "--max-restarts -1", "--max-restarts must be 0 or more"),
        ("max_restarts must be 0 or more", "--max_restarts=-1", "--max-restarts must be 0 or more"),
        ("the limits of joint 'a' are inverted", "--limits a=2:1", "--limits of joint 'a' are inverted"),
        ("the target is far away", "--matrix T.txt", "--matrix is far away"),
        ("cannot open the table 'a.csv': no", "--batch a.csv", "--batch: cannot open the table 'a.csv': no"),
        ("a.csv: line 3: no", "--batch a.csv --seed 0", "--batch: a.csv: line 3: no"),
        ("File exists: 'out/rows'", "--output out --seed 1", "--output: File exists: 'out/rows'"),
        ("unknown robot ''", "--robot", "unknown robot ''"),
        (
            "--seed must be 0 or more; limits are fine",
            "--limits a=0:1 --seed -1",
            "--seed must be 0 or more; limits are fine",
        ),
        ("something else", "--seed 1", "something else"),
    ],
)
def test_the_flag_is_named_that_a_message_begins_with_or_shows_the_value_of(message, arguments, named):
    assert in_flags(message, arguments.split()) == named


BAD = [
    *[
        (("--limits", word), "--limits")
        for word in ("joint1=1:nan", "joint1=2:1", "joint1=0:1e30", "nope=0:1", "joint1")
    ],
    *[(("--robot", word), "--robot") for word in ("nope", "nope.urdf", "nope.toml", "/dev/zero", "", "-1")],
    (("--tip", "nope"), "--tip"),
    (("--base", "nope"), "--base"),
    (("--position", "nan", "0", "0"), "--position"),
    (("--position", "1e30", "0", "0"), "--position"),
    ((*POSE, "--quaternion", "0", "0", "0", "0"), "--quaternion"),
    ((*POSE, "--quaternion", "2", "0", "0", "0"), "--quaternion"),
    ((*POSE, "--rpy", "inf", "0", "0"), "--rpy"),
    (("--matrix", "nope.txt"), "--matrix"),
    ((*POSE, "--q0", "nan"), "--q0"),
    ((*POSE, "--q0", *7 * ["nan"]), "--q0"),
    ((*POSE, "--seed", "-1"), "--seed"),
    ((*POSE, "--backend", "nope"), "--backend"),
    ((*POSE, "--redundancy", "weighted", "--weight", "nan"), "--weight"),
    ((*POSE, "--deadline", "0"), "--deadline"),
    ((*POSE, "--deadline", "soon"), "--deadline"),
    *[((*POSE, f"--{name}", "-1"), f"--{name}") for name in ("position-tolerance", "max-iterations", "stall-ratio")],
    (("--batch", "nope.csv"), "--batch"),
    (("--batch", "nope"), "--batch"),
]


@pytest.mark.parametrize(
    ("arguments", "flag"), BAD, ids=lambda each: " ".join(each) if isinstance(each, tuple) else each
)
def test_a_bad_value_is_misuse_and_its_flag_is_named(capsys, arguments, flag):
    given = arguments if {"--position", "--matrix", "--batch"} & {*arguments} else (*POSE, *arguments)
    assert main(["solve", *given]) == 2
    out, err = capsys.readouterr()
    assert flag in err
    assert not out
    assert "Traceback" not in err


def test_no_file_can_be_written_in_place_of_a_folder(capsys):
    assert main(["urdf", "--output", "/"]) == 2
    assert "--output: Is a directory: '/'" in capsys.readouterr().err
