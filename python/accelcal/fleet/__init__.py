"""Many runs of many sensors: each fitted once, then what sensors have in common, what differs, and what ages.

Examples
--------
>>> from accelcal.fleet.summary import population
>>> import numpy as np
>>> rng = np.random.default_rng(1)
>>> sensor = np.repeat(np.arange(30), 4)
>>> y = 0.05 + 0.01 * rng.standard_normal(30)[sensor] + 0.002 * rng.standard_normal(120)
>>> spread = population(y, np.full(120, 1e-4), sensor)
>>> 0.007 < spread.between_sensors.value < 0.014 and 0.0015 < spread.run_to_run.value < 0.0025
True
"""
