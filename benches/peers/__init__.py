"""The product beside every peer that can run a workload: `python -m benches.peers`."""
