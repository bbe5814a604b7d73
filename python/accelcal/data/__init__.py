"""Data: a recording, the rig it was made on, units, and the quality of both."""
