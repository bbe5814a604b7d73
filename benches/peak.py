"""The peak of this process's memory; what `ru_maxrss` tells can be that of the process which started it."""

from pathlib import Path


def megabytes() -> float:
    """Return the largest resident memory since the program began, MB (Linux: VmHWM of proc(5))."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024
