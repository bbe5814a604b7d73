"""The formats of containers: by which bytes and endings each is known, what reads it, and what must be installed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Format:
    """One format; a file of this folder, called `reader`, has a function ``opened`` from a path to a `Source`."""

    name: str
    """As messages call it."""
    suffixes: tuple[str, ...]
    """Endings of file names."""
    reader: str
    library: str
    """Module that must be there."""
    marked: Callable[[bytes], bool] = field(repr=False)
    """Whether a file that begins with these bytes says that it is one."""
    extra: str = ""
    """Extra of the package that brings the library; "" where the package itself does."""
    units_from: str = ""
    """Where units stand, for messages."""
    spoken: str = ""
    """The name in a sentence on what is missing, where it says more."""
    unmarked: bool = False
    """Whether a file of this ending may begin with any bytes."""


_HDF5_MARK = b"\x89HDF\r\n\x1a\n"


def _begins(*marks: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(marks)


def _is_hdf5(head: bytes) -> bool:
    """MATLAB 7.3 puts a text of 512 bytes in front."""
    return head.startswith(_HDF5_MARK) or head[512:].startswith(_HDF5_MARK)


FORMATS = (
    Format("Parquet", (".parquet",), "parquet", "pyarrow", _begins(b"PAR1"), units_from="the column metadata"),
    Format("npz", (".npz",), "npz", "numpy", _begins(b"PK\x03\x04")),
    Format(
        "HDF5",
        (".h5", ".hdf5", ".mat"),
        "hdf5",
        "h5py",
        _is_hdf5,
        extra="hdf5",
        units_from="the data set's attributes",
        spoken="HDF5 (or MATLAB 7.3)",
    ),
    Format("MAT", (".mat",), "mat", "scipy", _begins(b"MATLAB 5.0 MAT-file"), unmarked=True),
    Format("TDMS", (".tdms",), "tdms", "nptdms", _begins(b"TDSm"), "tdms", "the channel's properties"),
    Format("MCAP", (".mcap",), "mcap", "mcap", _begins(b"\x89MCAP0\r\n"), "mcap", "the schema of the messages"),
)
"""Each is known by its first bytes, in this order."""
BY_NAME = {each.name: each for each in FORMATS}
SUFFIXES = tuple(dict.fromkeys(suffix for each in FORMATS for suffix in each.suffixes))
"""Endings of containers."""
