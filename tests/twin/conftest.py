"""How many models and records the twins are compared on: `ACCELCAL_HYPOTHESIS=long` for all of them."""

import os

from hypothesis import HealthCheck, settings

COMMON = {"deadline": None, "derandomize": True, "suppress_health_check": list(HealthCheck)}
settings.register_profile("twin", max_examples=60, **COMMON)
settings.register_profile("twin-long", max_examples=600, **COMMON)
settings.load_profile("twin-long" if os.environ.get("ACCELCAL_HYPOTHESIS") == "long" else "twin")
