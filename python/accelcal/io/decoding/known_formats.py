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
    Format(
        "xlsx",
        (".xlsx", ".xlsm"),
        "xlsx",
        "python_calamine",
        rb"PK\x03\x04.{26}(?:\[Content_Types\]|_rels/|docProps/|xl/)",
        extra="xlsx",
        units_from="the unit row",
        title="an Excel workbook",
    ),
    Format("npz", (".npz",), "npz", "numpy", rb"PK\x03\x04"),
    Format("npy", (".npy",), "npz", "numpy", rb"\x93NUMPY"),
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
    Format("ROS bag", (".bag",), "ros", "rosbags", rb"\#ROSBAG", "ros", _OF_MESSAGES),
    Format("ROS 2 bag", (".db3",), "ros", "rosbags", rb"SQLite format 3\x00", "ros", _OF_MESSAGES),
    Format(  # version 3 has a mark; version 2 begins with a number, a letter for its quality, and a space or zero
        "miniSEED", (".mseed", ".miniseed"), "mseed", "pymseed", rb"MS\x03|[0-9 \x00]{6}[DRQM][ \x00]", "mseed"
    ),
    Format("C3D", (".c3d",), "c3d", "c3d", rb"\x02P", "c3d", "the parameters of the file", unmarked=True),
)
"""Each is known by its first bytes, in this order."""
EXPORTERS = {
    rb"PK\x03\x04.{26}(?:info\.txt|log\.bin|activity\.bin)": "a gt3x recording (ActiGraph); export its raw data as CSV "
    "with ActiLife, or write them with read.gt3x of R",
    rb"PK\x03\x04(?!.{26}.{1,300}?\.npy)|PK\x05\x06": "a ZIP archive; unpack it, and give the recording that is in it",
    rb"ULog\x01\x12\x35": "a ULog of PX4; convert it with ulog2csv (pip install pyulog), and give the CSV of one topic",
    rb".{0,200}H Product:Blackbox": "a Blackbox log (Betaflight, INAV); convert it to CSV with blackbox_decode",
    rb"\xa3\x95\x80": "a DataFlash log of ArduPilot; convert it by mavlogdump.py --format csv (pip install pymavlink)",
    rb"\x1a\x45\xdf\xa3": "an IDE recording (enDAQ, Midé); export it as CSV with enDAQ Lab",
    rb"\xd0\xcf\x11\xe0": "an Excel workbook of before 2007; save it as .xlsx or CSV",
    rb"MD\xfc\x03": "a CWA recording (Axivity); convert it to CSV with OmGui or cwa-convert",
    rb"Device Identity\r?\n": "a recording of GENEActiv; convert it to CSV with the GENEActiv software",
    rb"\x1f\x8b|7z\xbc\xaf|BZh|\xfd7zXZ|\x28\xb5\x2f\xfd|Rar!": "a compressed file; unpack it, and give what is in it",
    rb"ARROW1|FEA1": "an Arrow or Feather file; write it as Parquet (pyarrow.parquet.write_table)",
    rb"RIFF.{4}WAVE": "a WAV file, which has no unit; write its samples as CSV with a column of the time",
    rb".{4}ftyp": "a video; extract its telemetry as CSV first (GoPro: gopro-telemetry)",
    rb"SIMPLE  =": "a FITS file; write its table as CSV (astropy.table)",
    rb"\x89PNG|%PDF|\xff\xd8\xff": "a picture or a document; give the recording itself",
}
"""What other files are, by the bytes with which they begin, and the tool that exports them."""
MARKS = {file_format.name: re.compile(file_format.mark, re.DOTALL) for file_format in FORMATS}
BY_NAME = {file_format.name: file_format for file_format in FORMATS}
SUFFIXES = tuple(dict.fromkeys(suffix for file_format in FORMATS for suffix in file_format.suffixes))
"""Endings of containers."""
