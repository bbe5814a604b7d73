"""The hook that reads the subject of a commit."""

import subprocess
from pathlib import Path

import pytest

HOOK = Path(__file__).parents[2] / "tools" / "hooks" / "commit-msg"


@pytest.mark.parametrize(
    ("subject", "accepted"),
    [
        ("fit: leave saturated samples out", True),
        ("Merge branch 'main'", True),
        ("Mend what a reading of the changes found", False),
        (f"fit: {'x' * 67}", True),
        (f"fit: {'x' * 68}", False),
    ],
)
def test_a_subject_says_where_and_what_in_72_characters(subject, accepted, tmp_path):
    (tmp_path / "message").write_text(f"{subject}\n\nA body of any length is fine.\n")
    done = subprocess.run([HOOK, tmp_path / "message"], capture_output=True, text=True)
    assert (done.returncode == 0) == accepted
    assert bool(done.stderr) != accepted
