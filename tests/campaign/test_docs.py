"""The example of docs/campaign.md runs as it stands."""

import re
import subprocess
import sys
from pathlib import Path

from accelcal import campaign

PAGE = Path(__file__).parents[2] / "docs" / "campaign.md"


def test_the_example_runs(tmp_path):
    module, script = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), flags=re.M | re.S)
    (tmp_path / module.splitlines()[0].removeprefix("# ")).write_text(module)
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, check=True, capture_output=True, timeout=300)
    found = campaign.load(tmp_path / "scale.sqlite")
    assert not found.errors
    normalised = found.values["error"] / found.values["sigma"]
    assert (normalised**2).mean() < 2.4  # chi-square of 20 dof, false alarm 0.05 %
