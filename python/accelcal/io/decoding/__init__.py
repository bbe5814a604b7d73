"""What a process of its own does with a container; nothing here imports the rest of the package (see `child`)."""
