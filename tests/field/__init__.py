"""First contact: files as users' loggers write them, with the faults that users reported."""
