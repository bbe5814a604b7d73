"""What loading costs: time beside a bare read, memory, and what it imports. Each prints its figure."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet

ROOT = Path(__file__).parents[2]

LOAD = """
import json, sys, time
from accelcal import io
from benches.peak import megabytes
from pyarrow import csv, parquet
read = csv.read_csv if sys.argv[1].endswith("csv") else parquet.read_table
def cost(job):
    begin = time.process_time()
    job(sys.argv[1])
    return time.process_time() - begin
if sys.argv[2] == "beside a bare read":
    cost(read)
    bare = cost(read)
else:
    bare = float("inf")  # what memory a bare read leaves behind would count as ours
begin = time.process_time()
recording = io.load(sys.argv[1])
print(json.dumps({
    "samples": len(recording.accel),
    "ratio": (time.process_time() - begin) / bare,
    "megabytes": megabytes(),
    "imported": [name for name in ("pint", "scipy.stats", "h5py", "pydantic", "matplotlib") if name in sys.modules],
}))
"""


def cost(path, how):
    run = [sys.executable, "-c", LOAD, str(path), how]
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=True)
    answer = json.loads(done.stdout)
    print(path.suffix, answer)
    return answer


def table(n):
    rng = np.random.default_rng(0)
    t = np.arange(n) / 1667
    return pa.table(
        {
            "t_s": t,
            "accel_m_per_s2": np.sin(t) + 0.01 * rng.standard_normal(n),
            "position_m": pa.array(np.cos(t), mask=np.arange(n) % 2 == 1),
            "temperature_degC": 20 + t / 1000,
        }
    )


def test_loading_a_csv_costs_little_more_than_reading_it(tmp_path):
    path = tmp_path / "run.csv"
    csv.write_csv(table(400_000), path)
    result = cost(path, "beside a bare read")
    assert result["samples"] == 400_000
    assert result["ratio"] < 8.0  # checks, clocks of their own and the digest beside the bare parse
    assert result["imported"] == []


def test_one_hour_of_parquet_loads_in_700_megabytes(tmp_path):
    path = tmp_path / "run.parquet"
    parquet.write_table(table(6_000_000), path)
    result = cost(path, "alone")
    assert result["samples"] == 6_000_000
    assert result["megabytes"] < 700  # the recording 192, the libraries 100, the table while it is split 300


def test_importing_io_imports_no_heavy_library():
    script = (
        "import sys, accelcal.io, accelcal.data.quality; "
        "heavy = ('pint', 'scipy.stats', 'scipy.signal', 'pyarrow', 'h5py', 'pydantic', 'matplotlib'); "
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
