"""The formats of containers: by which bytes and endings each is known, what reads it, and what must be installed."""

from __future__ import annotations

import re
from dataclasses import dataclass


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
    mark: bytes
    """Regular expression of the bytes with which it begins."""
    extra: str = ""
    """Extra of the package that brings the library; "" where the package itself does."""
    units_from: str = ""
    """Where units stand, for messages."""
    title: str = ""
    """The name in a sentence on what is missing, where it says more."""
    unmarked: bool = False
    """Whether a file of this ending may begin with any bytes."""
    scratch: bool = False
    """Whether its library writes temporary files."""


_OF_MESSAGES = "the definition of the messages"


FORMATS = (
    Format("Parquet", (".parquet",), "parquet", "pyarrow", rb"PAR1", units_from="the column metadata"),
    Format("npz", (".npz",), "npz", "numpy", rb"PK\x03\x04"),
    Format(
        "HDF5",
        (".h5", ".hdf5", ".mat"),
        "hdf5",
        "h5py",
        rb"(?:.{512})?\x89HDF\r\n\x1a\n",  # MATLAB 7.3 puts a text of 512 bytes in front
        extra="hdf5",
        units_from="the data set's attributes",
        title="HDF5 (or MATLAB 7.3)",
    ),
    Format("MAT", (".mat",), "mat", "scipy", rb"MATLAB 5\.0 MAT-file", unmarked=True),
    Format("TDMS", (".tdms",), "tdms", "nptdms", rb"TDSm", "tdms", "the channel's properties"),
    Format(  # a line with -1 alone, then one with the number of the data set
        "UFF",
        (".uff", ".unv"),
        "uff",
        "pyuff",
        rb" {0,6}-1 *\r?\n {0,6}\d{1,6}[b \r\n]",
        "uff",
        "the header of the data set",
    ),
    Format("MF4", (".mf4",), "mf4", "asammdf", rb"MDF     ", "mf4", "the channel", scratch=True),
    Format("MCAP", (".mcap",), "mcap", "mcap", rb"\x89MCAP0\r\n", "mcap", _OF_MESSAGES),
    Format("ROS bag", (".bag",), "bag", "rosbags", rb"\#ROSBAG", "ros", _OF_MESSAGES),
    Format("ROS 2 bag", (".db3",), "bag", "rosbags", rb"SQLite format 3\x00", "ros", _OF_MESSAGES),
    Format(  # version 3 has a mark; version 2 begins with a number, a letter for its quality, and a space or zero
        "miniSEED", (".mseed", ".miniseed"), "mseed", "pymseed", rb"MS\x03|[0-9 \x00]{6}[DRQM][ \x00]", "mseed"
    ),
    Format("C3D", (".c3d",), "c3d", "c3d", rb"\x02P", "c3d", "the parameters of the file", unmarked=True),
)
"""Each is known by its first bytes, in this order."""
MARKS = {file_format.name: re.compile(file_format.mark, re.DOTALL) for file_format in FORMATS}
BY_NAME = {file_format.name: file_format for file_format in FORMATS}
SUFFIXES = tuple(dict.fromkeys(suffix for file_format in FORMATS for suffix in file_format.suffixes))
"""Endings of containers."""
