"""The formats of containers: by which bytes and endings each is known, what reads it, and what must be installed."""

from __future__ import annotations

import re
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
    title: str = ""
    """The name in a sentence on what is missing, where it says more."""
    unmarked: bool = False
    """Whether a file of this ending may begin with any bytes."""
    scratch: bool = False
    """Whether its library writes temporary files."""


_HDF5_MARK = b"\x89HDF\r\n\x1a\n"


_OF_MESSAGES = "the definition of the messages"


def _begins(*marks: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(marks)


def _is_hdf5(head: bytes) -> bool:
    """MATLAB 7.3 puts a text of 512 bytes in front."""
    return head.startswith(_HDF5_MARK) or head[512:].startswith(_HDF5_MARK)


def _is_uff(head: bytes) -> bool:
    """A line with -1 alone, then one with the number of the data set."""
    return re.match(rb" {0,6}-1 *\r?\n {0,6}\d{1,6}[b \r\n]", head) is not None


def _is_mseed(head: bytes) -> bool:
    """Version 3 has a mark; version 2 begins with a number, a letter for its quality, and a space or zero."""
    return head.startswith(b"MS\x03") or re.match(rb"[0-9 \x00]{6}[DRQM][ \x00]", head) is not None


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
        title="HDF5 (or MATLAB 7.3)",
    ),
    Format("MAT", (".mat",), "mat", "scipy", _begins(b"MATLAB 5.0 MAT-file"), unmarked=True),
    Format("TDMS", (".tdms",), "tdms", "nptdms", _begins(b"TDSm"), "tdms", "the channel's properties"),
    Format("UFF", (".uff", ".unv"), "uff", "pyuff", _is_uff, "uff", "the header of the data set"),
    Format("MF4", (".mf4",), "mf4", "asammdf", _begins(b"MDF     "), "mf4", "the channel", scratch=True),
    Format("MCAP", (".mcap",), "mcap", "mcap", _begins(b"\x89MCAP0\r\n"), "mcap", _OF_MESSAGES),
    Format("ROS bag", (".bag",), "bag", "rosbags", _begins(b"#ROSBAG"), "ros", _OF_MESSAGES),
    Format("ROS 2 bag", (".db3",), "bag", "rosbags", _begins(b"SQLite format 3\x00"), "ros", _OF_MESSAGES),
    Format("miniSEED", (".mseed", ".miniseed"), "mseed", "pymseed", _is_mseed, "mseed"),
    Format("C3D", (".c3d",), "c3d", "c3d", _begins(b"\x02P"), "c3d", "the parameters of the file", unmarked=True),
)
"""Each is known by its first bytes, in this order."""
BY_NAME = {each.name: each for each in FORMATS}
SUFFIXES = tuple(dict.fromkeys(suffix for each in FORMATS for suffix in each.suffixes))
"""Endings of containers."""
