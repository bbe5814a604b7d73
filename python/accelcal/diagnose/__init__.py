"""Which physical effect is missing: every candidate through the same gains, one Gram matrix, a search over sets."""

from accelcal.diagnose.candidates import Item, candidates_for
from accelcal.diagnose.evidence import Evidence, Known
from accelcal.diagnose.gains import log_survival, score_gain, variance_gain
from accelcal.diagnose.limits import sizes
from accelcal.diagnose.scan import ALPHA, LEAST_BLOCKS, Candidate, Scan, Verdict, largest, scan
from accelcal.diagnose.search import Search, block_length
from accelcal.diagnose.ties import RIVAL_CORRELATION, THIN, Finding, shared

__all__ = [
    "ALPHA",
    "LEAST_BLOCKS",
    "RIVAL_CORRELATION",
    "THIN",
    "Candidate",
    "Evidence",
    "Finding",
    "Item",
    "Known",
    "Scan",
    "Search",
    "Verdict",
    "block_length",
    "candidates_for",
    "largest",
    "log_survival",
    "scan",
    "score_gain",
    "shared",
    "sizes",
    "variance_gain",
]
